#pragma once

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/TwistWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/Imu.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <string>

#include "vi_ekf_slam/LoopClosure.h"
#include "vi_ekf_slam/StereoFeatureArray.h"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"

/// Messages to measurements and estimates to messages. No logging and no exceptions: what cannot be used is a
/// value.
namespace vi_ekf_slam::conversions {

/// Why a message did not become a measurement.
enum class Rejection {
  kNone,
  kZeroStamp,  ///< header.stamp is 0: nobody set it
  kWrongFrame, ///< header.frame_id is empty or not the frame of this input
  kNoData,     ///< covariance[0] is -1, which says that the quantity was not measured
  kNotFinite,  ///< NaN or infinity
};

/// In words, for counts and warnings.
const char* describe(Rejection rejection);

template <typename Sample>
struct Converted {
  std::optional<Sample> sample;
  Rejection rejection = Rejection::kNone;
};

struct ConvertedFrame {
  std::optional<StereoFrame> sample;
  Rejection rejection = Rejection::kNone;
  std::size_t repeated_ids = 0; ///< features dropped because their id came before in the same array
};

/// The name as tf2 wants it: tf1's leading slash removed.
std::string frameName(const std::string& frame_id);

Stamp toStamp(const ros::Time& time);
ros::Time toTime(Stamp stamp);
std_msgs::Header toHeader(Stamp stamp, const std::string& frame_id);

/// `imu_frame` is what header.frame_id must be.
Converted<ImuSample> toImu(const sensor_msgs::Imu& message, const std::string& imu_frame);

/// Linear velocity of the origin of header.frame_id along its axes, whatever frame that is.
Converted<VelocitySample> toVelocity(const geometry_msgs::TwistWithCovarianceStamped& message);
/// The same of child_frame_id; the pose is not used.
Converted<VelocitySample> toVelocity(const nav_msgs::Odometry& message);

/// What is known of the biases: the twist is their mean, in the IMU frame; of the covariance the diagonal
/// counts.
Converted<TwistBias> toTwistBias(const geometry_msgs::TwistWithCovarianceStamped& message,
                                 const std::string& imu_frame);

/// `left_frame` is the left optical frame; empty: not known yet, so any is taken. Of features with the same
/// id the first is kept. Pixels that are not finite are left to the estimator, which counts features one by
/// one.
ConvertedFrame toFrame(const StereoFeatureArray& message, const std::string& left_frame);

/// The way back.
StereoFeatureArray toMessage(const StereoFrame& frame, const std::string& left_frame);

Eigen::Vector3d toEigen(const geometry_msgs::Vector3& v);
Eigen::Vector3d toEigen(const geometry_msgs::Point& p);
Eigen::Quaterniond toEigen(const geometry_msgs::Quaternion& q);
geometry_msgs::Point toPoint(const Eigen::Vector3d& p);
geometry_msgs::Pose toPose(const SE3& pose);
/// The quaternion is normalised.
SE3 toSE3(const geometry_msgs::Transform& transform);
SE3 toSE3(const geometry_msgs::Pose& pose);

/// parent_T_child as a message.
geometry_msgs::TransformStamped toTransform(const SE3& parent_T_child, Stamp stamp, const std::string& parent,
                                            const std::string& child);
geometry_msgs::PoseWithCovarianceStamped toPoseMessage(const StateEstimate& state,
                                                       const std::string& map_frame);
/// `frame`: whose pose it is.
LoopClosure toMessage(const ClosedLoop& loop, const std::string& map_frame, const std::string& frame);
/// Pose in `map_frame`, twist in `imu_frame`.
nav_msgs::Odometry toOdometry(const StateEstimate& state, const std::string& map_frame,
                              const std::string& imu_frame);

} // namespace vi_ekf_slam::conversions
