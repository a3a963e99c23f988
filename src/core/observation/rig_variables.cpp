#include "vi_ekf_slam/core/observation/rig_variables.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {

// Of the variables in a saved map.
const std::array<const char*, RigVariables::kParts> RigVariables::kNames = {
    "camera_rotation", "camera_translation", "camera_time_offset", "scale"};

void RigVariables::addTo(Filter& filter, const Options& options) {
  const auto add = [&filter](Part part, double mean, const Eigen::VectorXd& sigma) {
    if (sigma.minCoeff() > 0.0)
      filter.augment(Chart::kVector, Eigen::VectorXd::Constant(sigma.size(), mean),
                     Eigen::MatrixXd(sigma.cwiseAbs2().asDiagonal()), {}, kNames[part]);
  };
  add(kRotation, 0.0, options.rotation_sigma);
  add(kTranslation, 0.0, options.translation_sigma);
  add(kTimeOffset, options.time_offset, Eigen::VectorXd::Constant(1, options.time_offset_sigma));
  add(kScale, 0.0, Eigen::VectorXd::Constant(1, options.scale_sigma));
}

bool RigVariables::isCorrection(const std::string& name) {
  return name == kNames[kRotation] || name == kNames[kTranslation] || name == kNames[kScale];
}

Eigen::Matrix<double, 13, 1> RigVariables::numbersOf(const StereoRig& given) {
  const Eigen::Matrix3d& C = given.cam_T_imu.rotation();
  Eigen::Matrix<double, 13, 1> numbers;
  numbers << C.col(0), C.col(1), C.col(2), given.cam_T_imu.translation(), given.camera.baseline;
  return numbers;
}

RigVariables::RigVariables(const Variables& variables) {
  for (std::size_t part = 0; part < kParts; ++part) {
    handles_[part] = variables.find(kNames[part]);
    if (!handles_[part]) continue;
    if (!first_) first_ = handles_[part];
    size_ += variables.sizeOf(*handles_[part]);
  }
}

Eigen::VectorXd RigVariables::meanOf(const Filter& filter, Part part, const Eigen::VectorXd& error) const {
  const Eigen::VectorXd mean = filter.variables().mean(*at(part));
  return error.size() > 0 ? Eigen::VectorXd(mean + error.segment(column(filter, part), mean.size())) : mean;
}

SE3 RigVariables::camTImu(const Filter& filter, const SE3& given, const Eigen::VectorXd& error) const {
  SE3 T = given;
  if (at(kRotation)) T = SE3(so3::Exp(meanOf(filter, kRotation, error)) * T.rotation(), T.translation());
  if (at(kTranslation)) T = SE3(T.rotation(), T.translation() + meanOf(filter, kTranslation, error));
  return T;
}

StereoCamera RigVariables::camera(const Filter& filter, const StereoCamera& given) const {
  StereoCamera camera = given;
  camera.baseline *= scale(filter);
  return camera;
}

double RigVariables::scale(const Filter& filter, const Eigen::VectorXd& error) const {
  return at(kScale) ? 1.0 + meanOf(filter, kScale, error)[0] : 1.0;
}

double RigVariables::timeOffset(const Filter& filter, const Eigen::VectorXd& error) const {
  return meanOf(filter, kTimeOffset, error)[0];
}

RigVariables::PointJacobian::PointJacobian(const RigVariables& variables, const Filter& filter,
                                           const SE3& given, const Vector6d& twist,
                                           const Eigen::VectorXd& error)
    : size_(variables.size()),
      cam_T_imu_(variables.camTImu(filter, given, error)),
      scale_(variables.scale(filter, error)),
      twist_(twist) {
  for (const Part part : {kRotation, kTranslation, kTimeOffset, kScale})
    columns_[part] = variables.at(part) ? variables.column(filter, part) : -1;
  by_rotation_.setZero();
  if (variables.at(kRotation)) by_rotation_ = so3::leftJacobian(variables.meanOf(filter, kRotation, error));
}

/// q = C r + t of a point r of the body's frame, which passes at -(w x r + v).
Eigen::Matrix3Xd RigVariables::PointJacobian::operator()(const Eigen::Vector3d& q) const {
  Eigen::Matrix3Xd J = Eigen::Matrix3Xd::Zero(3, size_);
  const Eigen::Matrix3d& C = cam_T_imu_.rotation();
  const Eigen::Vector3d lever = q - cam_T_imu_.translation();
  if (columns_[kRotation] >= 0) J.middleCols<3>(columns_[kRotation]) = -so3::hat(lever) * by_rotation_;
  if (columns_[kTranslation] >= 0) J.middleCols<3>(columns_[kTranslation]).setIdentity();
  if (columns_[kTimeOffset] >= 0)
    J.col(columns_[kTimeOffset]) =
        -(C * (twist_.tail<3>().cross(C.transpose() * lever) + twist_.head<3>()));
  if (columns_[kScale] >= 0) J.col(columns_[kScale]) = -q / scale_;
  return J;
}

Eigen::Vector3d RigVariables::PointJacobian::turn(const Eigen::VectorXd& error) const {
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  if (columns_[kRotation] >= 0) turn += by_rotation_ * error.segment<3>(columns_[kRotation]);
  if (columns_[kTimeOffset] >= 0)
    turn -= cam_T_imu_.rotation() * twist_.tail<3>() * error[columns_[kTimeOffset]];
  return turn;
}

RigEstimate RigVariables::estimate(const Filter& filter, const StereoRig& given,
                                   double known_time_offset) const {
  RigEstimate e{{camera(filter, given.camera), camTImu(filter, given.cam_T_imu)}, known_time_offset};
  const auto sigmas = [&](Part part) {
    return Eigen::VectorXd(filter.covariance(*at(part)).diagonal().cwiseMax(0.0).cwiseSqrt());
  };
  if (at(kRotation)) {
    const Eigen::Matrix3d J = so3::leftJacobian(filter.variables().mean(*at(kRotation)));
    const Eigen::Matrix3d P = J * filter.covariance(*at(kRotation)) * J.transpose();
    e.rotation_sigma = P.diagonal().cwiseMax(0.0).cwiseSqrt();
  }
  if (at(kTranslation)) e.translation_sigma = sigmas(kTranslation);
  if (at(kTimeOffset)) {
    e.time_offset = timeOffset(filter);
    e.time_offset_sigma = sigmas(kTimeOffset)[0];
  }
  if (at(kScale)) e.baseline_sigma = given.camera.baseline * sigmas(kScale)[0];
  return e;
}

} // namespace vi_ekf_slam
