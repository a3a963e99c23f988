#include "vi_ekf_slam/ros/output/publishers.hpp"

#include <utility>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kManyWaiting = 200; // poses, which no delay of /tf explains

} // namespace

Publishers::Publishers(ros::NodeHandle nh, const RosConfig& config, double max_jump_s,
                       const FrameTree& frames, MapPublisher::LandmarkSource landmarks,
                       MapPublisher::PathSource path)
    : config_(config),
      base_(frames, config),
      transforms_(nh, frames, config, max_jump_s),
      path_(nh, "path", config, listener_came_),
      dead_reckoning_path_(nh, "dead_reckoning/path", config, listener_came_),
      path_source_([this, path = std::move(path)] { return base_.path(path()); }),
      map_(
          nh, config, [this, landmarks = std::move(landmarks)] { return base_.landmarks(landmarks()); },
          path_source_, listener_came_),
      odometry_(nh.advertise<nav_msgs::Odometry>("odometry", kOutputQueue)),
      dead_reckoning_(nh.advertise<nav_msgs::Odometry>("dead_reckoning/odometry", kOutputQueue)),
      pose_(nh.advertise<geometry_msgs::PoseWithCovarianceStamped>("pose", kOutputQueue)),
      loops_(nh.advertise<LoopClosure>("loop_closures", kOutputQueue)) {}

void Publishers::publish(const Output& output, bool is_frame) {
  if (base_.name().empty()) return;
  const Stamp stamp = output.state.stamp;
  last_stamp_ = stamp;
  const StateEstimate in_map = base_.state(output.state);
  const SE3 start_T_base = base_.pose(output.odom_T_imu);
  const StateEstimate in_odom = smooth_.update(start_T_base, in_map);
  base_.lookForParent(stamp);
  transforms_.lookForParent(stamp);
  transforms_.publish(stamp, in_map.world_T_imu, in_odom.world_T_imu, base_);
  if (odometry_.getNumSubscribers() > 0)
    odometry_.publish(conversions::toOdometry(in_map, config_.map_frame, base_.name()));
  // Somebody else's odom is not the frame of this dead reckoning.
  if (dead_reckoning_.getNumSubscribers() > 0 && !transforms_.followsForeignOdometry())
    dead_reckoning_.publish(conversions::toOdometry(in_odom, config_.odom_frame, base_.name()));
  if (pose_.getNumSubscribers() > 0) pose_.publish(conversions::toPoseMessage(in_map, config_.map_frame));
  if (output.loop) publishLoop(*output.loop);
  path_.add(stamp, in_map.world_T_imu);
  dead_reckoning_path_.add(stamp, start_T_base);
  if (is_frame && map_.isDue(stamp)) map_.send(stamp);
}

/// The event, and the path as it is known after it.
void Publishers::publishLoop(const ClosedLoop& of_imu) {
  path_.correct(path_source_());
  if (loops_.getNumSubscribers() > 0)
    loops_.publish(conversions::toMessage(base_.loop(of_imu), config_.map_frame, base_.name()));
}

std::string Publishers::problem() const {
  std::string problem = base_.problem();
  if (problem.empty()) problem = transforms_.problem();
  if (!problem.empty() || !transforms_.followsForeignOdometry() || transforms_.waiting() < kManyWaiting)
    return problem;
  return "'" + config_.map_frame + "' -> '" + config_.odom_frame +
         "' is not published: publish_odom_tf is false, but /tf has no '" + config_.odom_frame + "' -> '" +
         base_.name() + "' of the measurements' time";
}

void Publishers::publishAll() {
  path_.send();
  dead_reckoning_path_.send();
  if (last_stamp_) map_.send(*last_stamp_);
}

void Publishers::publishUnsent() {
  path_.sendUnsent();
  dead_reckoning_path_.sendUnsent();
}

void Publishers::serveNewListeners() {
  if (listener_came_.exchange(false)) publishAll();
}

void Publishers::setRates(double path_period_s, double landmark_period_s, double max_bandwidth_bytes_s) {
  path_.setRate(path_period_s, max_bandwidth_bytes_s);
  dead_reckoning_path_.setRate(path_period_s, max_bandwidth_bytes_s);
  map_.setRate(landmark_period_s, max_bandwidth_bytes_s);
}

void Publishers::reset() {
  map_.reset(last_stamp_);
  path_.reset();
  dead_reckoning_path_.reset();
}

void Publishers::restart() {
  reset();
  smooth_.restart();
  transforms_.restart();
}

} // namespace vi_ekf_slam
