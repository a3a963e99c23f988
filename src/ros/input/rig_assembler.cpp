#include "vi_ekf_slam/ros/input/rig_assembler.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <sstream>
#include <utility>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"
#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {
namespace {

using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr double kRotationTolerance = 1e-3; // of R, which may be written with few digits
/// px; the two cameras of a rectified pair may differ by rounding only.
constexpr double kPixelTolerance = 1e-3;
// Beyond any rig that exists. What is larger is a fault, and could overflow what is computed from it.
constexpr double kMaxFocalLength = 1e6; ///< px; also of the principal point
constexpr double kMaxBaseline = 1e3;    ///< m
constexpr double kMaxVertical = 0.01; ///< of the baseline, by which rows would differ as a part of disparity
constexpr double kMaxLeverArm = 1e4;  ///< m

/// What is wrong with one CameraInfo by itself; empty: nothing.
std::string infoProblem(const sensor_msgs::CameraInfo& info, const std::string& topic) {
  const auto& P = info.P;
  if (!std::all_of(P.begin(), P.end(), [](double p) { return std::isfinite(p); })) {
    return "P of " + topic + " is not finite";
  }
  if (P[0] == 0.0 && P[5] == 0.0) return "P of " + topic + " is zero: the camera is not calibrated";
  if (P[0] <= 0.0 || P[5] <= 0.0) return "focal lengths in P of " + topic + " must be positive";
  if (std::max({P[0], P[5], std::abs(P[2]), std::abs(P[6])}) > kMaxFocalLength ||
      std::min(P[0], P[5]) < 1.0) {
    return "focal lengths in P of " + topic +
           " must be from 1 to 1e6 px, the principal point within +-1e6 px";
  }
  if (P[10] != 1.0 || P[1] != 0.0 || P[4] != 0.0 || P[8] != 0.0 || P[9] != 0.0) {
    return "P of " + topic + " must be [fx 0 cx Tx; 0 fy cy Ty; 0 0 1 0]";
  }
  const auto& R = info.R;
  if (!std::all_of(R.begin(), R.end(), [](double r) { return r == 0.0; }) &&
      !so3::isRotation(Eigen::Map<const RowMajor>(R.data()), kRotationTolerance))
    return "R of " + topic + " must be a rotation (within 1e-3), or zero";
  if (info.binning_x > 1 || info.binning_y > 1 || info.roi.x_offset != 0 || info.roi.y_offset != 0) {
    return topic + " has binning or a region of interest, which is not supported";
  }
  return {};
}

/// What keeps the two from being one rectified pair; empty: nothing.
std::string pairProblem(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right) {
  static constexpr std::pair<std::size_t, const char*> kShared[] = {
      {0, "fx"}, {5, "fy"}, {2, "cx"}, {6, "cy"}};
  std::ostringstream text;
  text.precision(12);
  for (const auto& [index, name] : kShared) {
    if (std::abs(left.P[index] - right.P[index]) <= kPixelTolerance) continue;
    text << "the pair is not rectified: " << name << " is " << left.P[index] << " px on the left and "
         << right.P[index] << " px on the right";
    return text.str();
  }
  const double vertical = std::max(std::abs(left.P[7]), std::abs(right.P[7]));
  if (vertical > std::max(kPixelTolerance, kMaxVertical * std::abs(right.P[3]))) {
    text << (vertical > std::abs(right.P[3])
                 ? "the cameras are one above the other, side by side is required "
                   "(import_calibration.py turns such a pair)"
                 : "the baseline has a vertical part, the pair is not rectified")
         << ": P[3] and P[7] are " << left.P[3] << " and " << left.P[7] << " on the left, " << right.P[3]
         << " and " << right.P[7] << " on the right, allowed: P[7] within 1 % of the right P[3]";
  } else if (left.P[3] != 0.0) {
    text << "P[3] of the left camera must be 0, it is " << left.P[3];
  } else if (!(right.P[3] < 0.0)) {
    text << "P[3] = -fx * baseline of the right camera must be negative, it is " << right.P[3];
  } else if (!(-right.P[3] / right.P[0] <= kMaxBaseline && -right.P[3] >= 1e-6 * right.P[0])) {
    text << "P[3] = -fx * baseline of the right camera must stand for 1e-6 to 1e3 m, it is " << right.P[3];
  }
  return text.str();
}

/// Whether the camera's own picture reaches beyond the borders of the rectified one: a lens that distorts, a
/// camera that is turned, another focal length or centre.
bool showsMore(const sensor_msgs::CameraInfo& info) {
  if (std::any_of(info.D.begin(), info.D.end(), [](double d) { return d != 0.0; })) return true;
  if (!rectification(info).isIdentity(1e-9)) return true;
  if (info.K[0] == 0.0) return false; // not stated
  static constexpr std::pair<std::size_t, std::size_t> kOfKAndP[] = {{0, 0}, {4, 5}, {2, 2}, {5, 6}};
  return std::any_of(std::begin(kOfKAndP), std::end(kOfKAndP), [&info](const auto& index) {
    return std::abs(info.K[index.first] - info.P[index.second]) > kPixelTolerance;
  });
}

} // namespace

std::string stereoProblem(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right,
                          const std::string& left_topic, const std::string& right_topic) {
  for (const std::string& problem : {infoProblem(left, left_topic), infoProblem(right, right_topic)}) {
    if (!problem.empty()) return problem;
  }
  return pairProblem(left, right);
}

StereoCamera stereoCamera(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right) {
  return {left.P[0], left.P[5], left.P[2], left.P[6], -right.P[3] / right.P[0]};
}

Eigen::Matrix3d rectification(const sensor_msgs::CameraInfo& info) {
  const Eigen::Matrix3d R = Eigen::Map<const RowMajor>(info.R.data());
  return R.isZero(0.0) ? Eigen::Matrix3d::Identity() : so3::normalized(R);
}

RigAssembler::RigAssembler(const FrameTree& frames, std::string left_topic, std::string right_topic)
    : frames_(frames), left_topic_(std::move(left_topic)), right_topic_(std::move(right_topic)) {
  update();
}

void RigAssembler::setImuFrame(const std::string& imu_frame) {
  imu_frame_ = imu_frame;
  rig_.reset();
  update();
}

void RigAssembler::noteChange(const std::optional<sensor_msgs::CameraInfo>& held,
                              const sensor_msgs::CameraInfo& info) {
  if (rig_ && held && (held->P != info.P || held->R != info.R)) changed_later_ = "camera_info";
}

void RigAssembler::noteTransforms() {
  update();
  SE3 cam_T_imu;
  if (!rig_ || !transformProblem(cam_T_imu).empty() || !hasMoved(rig_->cam_T_imu, cam_T_imu)) return;
  changed_later_ = "the transform from '" + imu_frame_ + "' to '" + left_frame_ + "'";
}

void RigAssembler::addLeft(const sensor_msgs::CameraInfo& info) {
  noteChange(left_, info);
  if (rig_) return;
  left_ = info;
  left_frame_ = conversions::frameName(info.header.frame_id);
  update();
}

void RigAssembler::addRight(const sensor_msgs::CameraInfo& info) {
  noteChange(right_, info);
  if (rig_) return;
  right_ = info;
  update();
}

std::optional<ImageSize> RigAssembler::imageSize() const {
  if (!rig_ || left_->width == 0 || left_->height == 0) return std::nullopt;
  if (left_->width != right_->width || left_->height != right_->height) return std::nullopt;
  if (showsMore(*left_) || showsMore(*right_)) return std::nullopt;
  return ImageSize{static_cast<double>(left_->width), static_cast<double>(left_->height)};
}

std::string RigAssembler::transformProblem(SE3& cam_T_imu) const {
  if (imu_frame_.empty())
    return "the IMU's frame is not known yet (no IMU message; ros/imu_frame names it where there is none)";
  if (left_frame_.empty()) return "frame_id of " + left_topic_ + " is empty";
  const auto found = frames_.find(left_frame_, imu_frame_);
  if (!found)
    return "no transform from '" + imu_frame_ + "' to '" + left_frame_ +
           "' on /tf_static (a calibration file's: import_calibration.py --imu-frame " + imu_frame_ + ")";
  cam_T_imu = SE3(rectification(*left_), Eigen::Vector3d::Zero()) * *found;
  if (cam_T_imu.translation().norm() <= kMaxLeverArm && cam_T_imu.rotation().allFinite()) return {};
  return "the transform from '" + imu_frame_ + "' to '" + left_frame_ + "' is not one of at most 10 km";
}

void RigAssembler::update() {
  if (rig_) return;
  problem_.clear();
  const auto note = [this](const std::string& text) { addProblem(problem_, text); };
  note(left_ ? infoProblem(*left_, left_topic_) : "no sensor_msgs/CameraInfo on " + left_topic_);
  note(right_ ? infoProblem(*right_, right_topic_) : "no sensor_msgs/CameraInfo on " + right_topic_);
  if (problem_.empty()) note(pairProblem(*left_, *right_));
  SE3 cam_T_imu;
  if (left_) note(transformProblem(cam_T_imu));
  if (problem_.empty()) rig_ = StereoRig{stereoCamera(*left_, *right_), cam_T_imu};
}

} // namespace vi_ekf_slam
