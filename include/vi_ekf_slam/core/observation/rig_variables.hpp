#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/geometry/camera.hpp"

namespace vi_ekf_slam {

/// A rig's calibration as it is known: its mean, and a standard deviation of each part; 0: taken as known.
struct RigEstimate {
  StereoRig rig;
  double time_offset = 0.0; ///< s, of the IMU's clock ahead of the camera's stamps: t_imu = t_cam + offset
  /// Of C (rad, along the left camera's axes) and t (m) of cam_T_imu = (C, t).
  Eigen::Vector3d rotation_sigma = Eigen::Vector3d::Zero(), translation_sigma = Eigen::Vector3d::Zero();
  double time_offset_sigma = 0.0; ///< s
  double baseline_sigma = 0.0;    ///< m
  /// s, first and last stamp of what told it; 0: not known.
  Eigen::Vector2d recording = Eigen::Vector2d::Zero();

  bool isEstimated() const {
    return rotation_sigma.maxCoeff() > 0.0 || translation_sigma.maxCoeff() > 0.0 || time_offset_sigma > 0.0 ||
           baseline_sigma > 0.0;
  }
};

/// What may be wrong with a rig's calibration, as variables of the filter's core: with cam_T_imu = (C, t),
/// C = Exp(phi) C0 and t = t0 + tau, the time offset of the camera, and the relative error of the baseline.
class RigVariables {
 public:
  /// Standard deviation of each beforehand; 0: it is known, and no variable.
  struct Options {
    Eigen::Vector3d rotation_sigma = Eigen::Vector3d::Zero();    ///< rad, along the left camera's axes
    Eigen::Vector3d translation_sigma = Eigen::Vector3d::Zero(); ///< m, the same
    double time_offset_sigma = 0.0;                              ///< s
    double scale_sigma = 0.0;                                    ///< 1
    double time_offset = 0.0;                                    ///< s, its mean

    /// What holds in the place of the rig that is told, from an earlier estimate.
    struct Known {
      SE3 cam_T_imu;
      double baseline;           ///< m
      Eigen::Vector2d recording; ///< RigEstimate's
    };
    std::optional<Known> known;

    bool isEstimated() const {
      return rotation_sigma.maxCoeff() > 0.0 || translation_sigma.maxCoeff() > 0.0 ||
             time_offset_sigma > 0.0 || scale_sigma > 0.0;
    }
    StereoRig appliedTo(StereoRig rig) const {
      if (known) {
        rig.cam_T_imu = known->cam_T_imu;
        rig.camera.baseline = known->baseline;
      }
      return rig;
    }
  };
  /// Adds them to a filter whose core is not closed, one behind the other.
  static void addTo(Filter& filter, const Options& options);

  /// A saved map has, as a variable without errors, the rig that was given: camera_rotation,
  /// camera_translation and scale are corrections of it, and of no other one.
  static constexpr const char* kGivenRig = "given_rig";
  static bool isCorrection(const std::string& name);
  /// Its numbers: the upper 3 x 4 of cam_T_imu, column by column, and the baseline (m).
  static Eigen::Matrix<double, 13, 1> numbersOf(const StereoRig& given);

  RigVariables() = default;
  /// Those that a filter has.
  explicit RigVariables(const Variables& variables);

  bool isNone() const { return size_ == 0; }
  Eigen::Index row(const Filter& filter) const { return filter.rowOf(*first_); }
  Eigen::Index size() const { return size_; }
  bool hasTimeOffset() const { return at(kTimeOffset).has_value(); }

  // With `error` (size() entries, or none) added to the means:
  /// The rig given, corrected.
  SE3 camTImu(const Filter& filter, const SE3& given, const Eigen::VectorXd& error = {}) const;
  StereoCamera camera(const Filter& filter, const StereoCamera& given) const;
  /// Of the baseline over the given one.
  double scale(const Filter& filter, const Eigen::VectorXd& error = {}) const;
  double timeOffset(const Filter& filter, const Eigen::VectorXd& error = {}) const;

  /// 3 x size(): by what each of them moves a point q (m) of the left camera's frame as the pair sees it, while
  /// the body moves at `twist` (m/s, rad/s, body): a longer baseline has it nearer. Of the means when it was
  /// made, and `error` as above.
  class PointJacobian {
   public:
    PointJacobian(const RigVariables& variables, const Filter& filter, const SE3& given,
                  const Vector6d& twist, const Eigen::VectorXd& error);
    Eigen::Matrix3Xd operator()(const Eigen::Vector3d& q) const;
    /// By which `error` turns all points about the body, rad, in the camera's axes.
    Eigen::Vector3d turn(const Eigen::VectorXd& error) const;

   private:
    std::array<Eigen::Index, 4> columns_; ///< of each part; -1: it is known
    Eigen::Index size_;
    SE3 cam_T_imu_;
    double scale_;
    Eigen::Matrix3d by_rotation_;
    Vector6d twist_;
  };
  PointJacobian pointJacobian(const Filter& filter, const SE3& given, const Vector6d& twist,
                              const Eigen::VectorXd& error = {}) const {
    return {*this, filter, given, twist, error};
  }

  RigEstimate estimate(const Filter& filter, const StereoRig& given, double known_time_offset) const;

 private:
  enum Part { kRotation, kTranslation, kTimeOffset, kScale, kParts };
  static const std::array<const char*, kParts> kNames;

  const std::optional<Handle>& at(Part part) const { return handles_[part]; }
  Eigen::VectorXd meanOf(const Filter& filter, Part part, const Eigen::VectorXd& error) const;
  Eigen::Index column(const Filter& filter, Part part) const { return filter.rowOf(*at(part)) - row(filter); }

  std::array<std::optional<Handle>, kParts> handles_;
  std::optional<Handle> first_;
  Eigen::Index size_ = 0;
};

} // namespace vi_ekf_slam
