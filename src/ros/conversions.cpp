#include "vi_ekf_slam/ros/conversions.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_set>

namespace vi_ekf_slam::conversions {
namespace {

Rejection checkHeader(const std_msgs::Header& header, const std::string& frame) {
  if (header.stamp.isZero()) return Rejection::kZeroStamp;
  const std::string name = frameName(header.frame_id);
  if (name.empty() || (!frame.empty() && name != frame)) return Rejection::kWrongFrame;
  return Rejection::kNone;
}

/// The 3x3 block at the top left of a row-major covariance with `stride` columns; nothing if it is all zero,
/// which in ROS says "unknown".
template <typename Array>
std::optional<Eigen::Matrix3d> covarianceBlock(const Array& covariance, Eigen::Index stride) {
  using Rows = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>, 0, Eigen::OuterStride<>>;
  const Eigen::Matrix3d block = Rows(covariance.data(), Eigen::OuterStride<>(stride));
  if ((block.array() == 0.0).all()) return std::nullopt;
  return block;
}

bool isFinite(const Eigen::Vector3d& value, const std::optional<Eigen::Matrix3d>& covariance) {
  return value.allFinite() && (!covariance || covariance->allFinite());
}

/// `array` <- `matrix`, row-major.
template <typename Array>
void copyCovariance(const Matrix6d& matrix, Array& array) {
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(array.data()) = matrix;
}

} // namespace

const char* describe(Rejection rejection) {
  switch (rejection) {
    case Rejection::kNone:
      return "usable";
    case Rejection::kZeroStamp:
      return "stamp is zero";
    case Rejection::kWrongFrame:
      return "wrong frame";
    case Rejection::kNoData:
      return "covariance[0] = -1, no data";
    case Rejection::kNotFinite:
      return "not finite";
  }
  return "unknown";
}

std::string frameName(const std::string& frame_id) {
  return !frame_id.empty() && frame_id.front() == '/' ? frame_id.substr(1) : frame_id;
}

Stamp toStamp(const ros::Time& time) { return static_cast<Stamp>(time.toNSec()); }

ros::Time toTime(Stamp stamp) {
  ros::Time time;
  return time.fromNSec(static_cast<std::uint64_t>(stamp));
}

std_msgs::Header toHeader(Stamp stamp, const std::string& frame_id) {
  std_msgs::Header header;
  header.stamp = toTime(stamp);
  header.frame_id = frame_id;
  return header;
}

Converted<ImuSample> toImu(const sensor_msgs::Imu& message, const std::string& imu_frame) {
  if (const auto bad = checkHeader(message.header, imu_frame); bad != Rejection::kNone) return {{}, bad};
  if (message.angular_velocity_covariance[0] == -1.0) return {{}, Rejection::kNoData};
  ImuSample sample;
  sample.stamp = toStamp(message.header.stamp);
  sample.angular_velocity = toEigen(message.angular_velocity);
  sample.covariance = covarianceBlock(message.angular_velocity_covariance, 3);
  if (!isFinite(sample.angular_velocity, sample.covariance)) return {{}, Rejection::kNotFinite};
  const Eigen::Vector3d acceleration = toEigen(message.linear_acceleration);
  // Drivers of gyros alone leave it zero, which an accelerometer never reads.
  if (message.linear_acceleration_covariance[0] != -1.0 && !(acceleration.array() == 0.0).all()) {
    sample.acceleration = acceleration;
    sample.acceleration_covariance = covarianceBlock(message.linear_acceleration_covariance, 3);
    if (!isFinite(*sample.acceleration, sample.acceleration_covariance)) return {{}, Rejection::kNotFinite};
  }
  return {sample, Rejection::kNone};
}

Converted<VelocitySample> toVelocity(const geometry_msgs::TwistWithCovarianceStamped& message) {
  if (const auto bad = checkHeader(message.header, {}); bad != Rejection::kNone) return {{}, bad};
  if (message.twist.covariance[0] == -1.0) return {{}, Rejection::kNoData};
  const VelocitySample sample{toStamp(message.header.stamp), toEigen(message.twist.twist.linear),
                              covarianceBlock(message.twist.covariance, 6)};
  if (!isFinite(sample.linear_velocity, sample.covariance)) return {{}, Rejection::kNotFinite};
  return {sample, Rejection::kNone};
}

Converted<VelocitySample> toVelocity(const nav_msgs::Odometry& message) {
  geometry_msgs::TwistWithCovarianceStamped twist;
  twist.header = message.header;
  twist.header.frame_id = message.child_frame_id;
  twist.twist = message.twist;
  return toVelocity(twist);
}

Converted<TwistBias> toTwistBias(const geometry_msgs::TwistWithCovarianceStamped& message,
                                 const std::string& imu_frame) {
  if (const auto bad = checkHeader(message.header, imu_frame); bad != Rejection::kNone) return {{}, bad};
  TwistBias bias;
  bias.mean << toEigen(message.twist.twist.linear), toEigen(message.twist.twist.angular);
  for (std::size_t i = 0; i < 6; ++i) {
    const double variance = message.twist.covariance[7 * i];
    if (!(variance > 0.0)) return {{}, Rejection::kNoData};
    bias.sigma[static_cast<Eigen::Index>(i)] = std::sqrt(variance);
  }
  if (!bias.mean.allFinite() || !bias.sigma.allFinite()) return {{}, Rejection::kNotFinite};
  return {bias, Rejection::kNone};
}

ConvertedFrame toFrame(const StereoFeatureArray& message, const std::string& left_frame) {
  if (const auto bad = checkHeader(message.header, left_frame); bad != Rejection::kNone) return {{}, bad, 0};
  StereoFrame frame;
  frame.stamp = toStamp(message.header.stamp);
  frame.features.reserve(message.features.size());
  std::unordered_set<FeatureId> seen(message.features.size());
  for (const StereoFeature& f : message.features) {
    if (!seen.insert(f.id).second) continue;
    frame.features.push_back({f.id, StereoPixels(f.u_left, f.v_left, f.u_right, f.v_right), f.sigma, f.walk});
    Descriptor descriptor;
    if (f.descriptor.size() != descriptor.size()) continue; // another front end's of another kind
    std::copy(f.descriptor.begin(), f.descriptor.end(), descriptor.begin());
    frame.features.back().descriptor = descriptor;
  }
  const std::size_t repeated = message.features.size() - frame.features.size();
  return {std::move(frame), Rejection::kNone, repeated};
}

StereoFeatureArray toMessage(const StereoFrame& frame, const std::string& left_frame) {
  StereoFeatureArray message;
  message.header = toHeader(frame.stamp, left_frame);
  message.features.reserve(frame.features.size());
  for (const StereoFeatureObservation& f : frame.features) {
    StereoFeature feature;
    feature.id = f.id;
    feature.u_left = f.pixels[0];
    feature.v_left = f.pixels[1];
    feature.u_right = f.pixels[2];
    feature.v_right = f.pixels[3];
    feature.sigma = static_cast<float>(f.sigma);
    feature.walk = static_cast<float>(f.walk);
    if (f.descriptor) feature.descriptor.assign(f.descriptor->begin(), f.descriptor->end());
    message.features.push_back(std::move(feature));
  }
  return message;
}

Eigen::Vector3d toEigen(const geometry_msgs::Vector3& v) { return {v.x, v.y, v.z}; }
Eigen::Vector3d toEigen(const geometry_msgs::Point& p) { return {p.x, p.y, p.z}; }
Eigen::Quaterniond toEigen(const geometry_msgs::Quaternion& q) { return {q.w, q.x, q.y, q.z}; }

geometry_msgs::Point toPoint(const Eigen::Vector3d& p) {
  geometry_msgs::Point point;
  point.x = p.x();
  point.y = p.y();
  point.z = p.z();
  return point;
}

geometry_msgs::Pose toPose(const SE3& pose) {
  Eigen::Quaterniond q(pose.rotation());
  q.normalize();
  geometry_msgs::Pose message;
  message.position = toPoint(pose.translation());
  message.orientation.x = q.x();
  message.orientation.y = q.y();
  message.orientation.z = q.z();
  message.orientation.w = q.w();
  return message;
}

SE3 toSE3(const geometry_msgs::Transform& transform) {
  return {toEigen(transform.rotation).normalized().toRotationMatrix(), toEigen(transform.translation)};
}

SE3 toSE3(const geometry_msgs::Pose& pose) {
  return {toEigen(pose.orientation).normalized().toRotationMatrix(), toEigen(pose.position)};
}

geometry_msgs::TransformStamped toTransform(const SE3& parent_T_child, Stamp stamp, const std::string& parent,
                                            const std::string& child) {
  const geometry_msgs::Pose pose = toPose(parent_T_child);
  geometry_msgs::TransformStamped message;
  message.header = toHeader(stamp, parent);
  message.child_frame_id = child;
  message.transform.translation.x = pose.position.x;
  message.transform.translation.y = pose.position.y;
  message.transform.translation.z = pose.position.z;
  message.transform.rotation = pose.orientation;
  return message;
}

geometry_msgs::PoseWithCovarianceStamped toPoseMessage(const StateEstimate& state,
                                                       const std::string& map_frame) {
  geometry_msgs::PoseWithCovarianceStamped message;
  message.header = toHeader(state.stamp, map_frame);
  message.pose.pose = toPose(state.world_T_imu);
  copyCovariance(state.pose_covariance, message.pose.covariance);
  return message;
}

LoopClosure toMessage(const ClosedLoop& loop, const std::string& map_frame, const std::string& frame) {
  LoopClosure message;
  message.header = toHeader(loop.ends.now, map_frame);
  message.before = toTime(loop.ends.before);
  message.child_frame_id = frame;
  message.pose.pose = toPose(loop.before_T_now);
  copyCovariance(loop.covariance, message.pose.covariance);
  message.landmarks = static_cast<std::uint32_t>(loop.landmarks);
  return message;
}

nav_msgs::Odometry toOdometry(const StateEstimate& state, const std::string& map_frame,
                              const std::string& imu_frame) {
  nav_msgs::Odometry message;
  message.header = toHeader(state.stamp, map_frame);
  message.child_frame_id = imu_frame;
  message.pose.pose = toPose(state.world_T_imu);
  copyCovariance(state.pose_covariance, message.pose.covariance);
  message.twist.twist.linear.x = state.twist[0];
  message.twist.twist.linear.y = state.twist[1];
  message.twist.twist.linear.z = state.twist[2];
  message.twist.twist.angular.x = state.twist[3];
  message.twist.twist.angular.y = state.twist[4];
  message.twist.twist.angular.z = state.twist[5];
  copyCovariance(state.twist_covariance, message.twist.covariance);
  return message;
}

} // namespace vi_ekf_slam::conversions
