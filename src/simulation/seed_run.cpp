#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/motion/dead_reckoning.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"
#include "vi_ekf_slam/simulation/inertial/told_truth.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"
#include "vi_ekf_slam/simulation/stale_repair.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kFartherOff = 1.0; // m, that a place taken for another one leaves the vehicle farther off

/// Takes a drive through a SlamSystem and compares what comes out.
class SeedRun {
 public:
  SeedRun(const Config& config, const DriveOptions& options, const InertialStudy& study)
      : study_(options.hasRawImu() ? study : InertialStudy()),
        simulator_(options),
        rig_(options.seed, simulator_.rig(), study_.disturbance),
        system_(options.hasRawImu() ? toldTheTruth(config, options) : config) {
    result_.seed = options.seed;
    if (options.hasRawImu()) result_.inertial.emplace();
  }

  SeedResult run() {
    system_.setRig(rig_.told());
    system_.onFrame([this](const Output& output) { compare(output); });
    system_.onReset([this](const std::string& /*reason*/, const PathEstimate& path) { end(path); });
    if (result_.inertial && study_.start == StudyStart::kGiven)
      system_.begin(drawnStart(*simulator_.state(), result_.seed));
    StaleRepair stale;
    ReturnWatch returns;
    while (std::optional<DriveStep> step = simulator_.next()) {
      stale.repair(*step);
      if (!first_frame_) first_frame_ = step->stamp;
      if (isBlind(step->stamp)) step->frame.features.clear();
      returns.add(step->frame);
      step->frame.stamp -= fromSeconds(rig_.timeOffset());
      if (returns.returned() && !returned_) returned_ = step->frame.stamp;
      if (!step->true_twist.empty()) twist_ = step->true_twist.front();
      for (Measurement& measurement : measurementsOf(*step)) {
        note(measurement, step->world_T_imu);
        system_.add(std::move(measurement));
      }
    }
    system_.flush();
    result_.yaw_fall = yaw_.largestFall();
    if (!result_.begun_anew) judgePath(system_.estimator().exactMap()().path, result_);
    if (!study_.disturbance.isNone()) {
      if (const auto estimate = system_.estimator().rig()) result_.inertial->rig = rig_.judge(*estimate);
    }
    return std::move(result_);
  }

 private:
  bool isBlind(Stamp stamp) const {
    const double time = secondsBetween(*first_frame_, stamp);
    return time >= study_.blind_from && time < study_.blind_from + study_.blind_for;
  }

  void note(const Measurement& measurement, const SE3& world_T_imu) {
    if (const auto* gyro = std::get_if<ImuSample>(&measurement)) return dead_reckoning_.process(*gyro);
    if (const auto* velocity = std::get_if<VelocitySample>(&measurement))
      return dead_reckoning_.process(*velocity);
    const Stamp stamp = stampOf(measurement);
    dead_reckoning_.advanceTo(stamp);
    frames_[stamp] = {world_T_imu, twist_, dead_reckoning_.pose()};
  }

  /// What comes after a reset is in another map.
  void end(const PathEstimate& path) {
    if (!result_.begun_anew) judgePath(path, result_);
    result_.begun_anew = true;
  }

  void compare(const Output& output) {
    if (result_.begun_anew) return;
    const StateEstimate& state = output.state;
    const FrameReport& report = output.report;
    if (!start_) begin(state);
    if (!(returned_ && *returned_ <= output.frame_stamp)) yaw_.add(state.pose_covariance);
    result_.frames_rejected += report.frame_rejected ? 1 : 0;
    result_.features += report.features;
    result_.features_used += report.used;
    result_.frames.push_back(errorsOf(output));
    countPlace(report);
    if (!isBlind(state.stamp)) return;
    result_.inertial->blind_nees = result_.frames.back().nees.position;
    result_.inertial->blind_position = result_.frames.back().position;
  }

  void begin(const StateEstimate& state) {
    start_ = state.stamp;
    if (!result_.inertial) return;
    const TrueState truth = *simulator_.stateAt(state.stamp);
    if (study_.start == StudyStart::kSelf) map_T_world_ = mapOfTruth(truth.world_T_imu, state.world_T_imu);
    const SE3 pose = map_T_world_ * truth.world_T_imu;
    InertialOutcome& outcome = *result_.inertial;
    outcome.start_delay = secondsBetween(*first_frame_, state.stamp);
    outcome.first_pose = poseNees(pose, state).pose;
    outcome.first_tilt = tiltNees(pose, state);
    outcome.first_velocity = velocityNees(truth.world_T_imu.rotation().transpose() * truth.velocity, state);
  }

  /// In the map, at the estimate's stamp, which an estimated offset may have moved from the frame's.
  SE3 truthOf(const Output& output) const {
    const Stamp now = output.state.stamp;
    if (const auto state = simulator_.stateAt(now)) return map_T_world_ * state->world_T_imu;
    const Frame& frame = frames_.at(output.frame_stamp);
    return frame.world_T_imu * SE3::Exp(secondsBetween(output.frame_stamp, now) * frame.twist);
  }

  FrameErrors errorsOf(const Output& output) const {
    const StateEstimate& state = output.state;
    const SE3& dead_reckoning =
        result_.inertial ? output.odom_T_imu : frames_.at(output.frame_stamp).dead_reckoning;
    FrameErrors errors;
    errors.time = secondsBetween(*start_, state.stamp);
    errors.stamp = state.stamp;
    errors.estimate = state.world_T_imu;
    errors.truth = truthOf(output);
    errors.nees = poseNees(errors.truth, state);
    errors.position = (errors.estimate.translation() - errors.truth.translation()).norm();
    errors.dead_reckoning = (dead_reckoning.translation() - errors.truth.translation()).norm();
    errors.yaw_sigma = std::sqrt(std::max(0.0, state.pose_covariance(5, 5)));
    errors.nis = output.report.nis;
    errors.nis_dof = output.report.nis_dof;
    errors.revisited = output.report.revisited;
    return errors;
  }

  void countPlace(const FrameReport& report) {
    if (!report.place_recognised) return;
    ++result_.places;
    const std::size_t now = result_.frames.size() - 1;
    const double before = now > 0 ? result_.frames[now - 1].position : 0.0;
    if (result_.frames[now].position > before + kFartherOff) ++result_.wrong_places;
  }

  /// The truth of a frame, and where its samples alone have led by then.
  struct Frame {
    SE3 world_T_imu;
    Vector6d twist;
    SE3 dead_reckoning;
  };

  InertialStudy study_;
  DriveSimulator simulator_;
  ToldRig rig_;
  SlamSystem system_;
  SeedResult result_;
  YawVarianceWatch yaw_;
  Vector6d twist_ = Vector6d::Zero(); ///< true one, of the last sample
  DeadReckoning dead_reckoning_;
  std::map<Stamp, Frame> frames_; ///< by their stamps
  std::optional<Stamp> first_frame_, start_;
  std::optional<Stamp> returned_; ///< of the first frame with an id that has come back
  SE3 map_T_world_;
};

} // namespace

void judgePath(const PathEstimate& path, SeedResult& result) {
  std::vector<FrameErrors>& frames = result.frames;
  if (frames.empty()) return;
  std::size_t nodes = 0;
  double sum = 0.0;
  auto node = path.nodes.begin();
  Eigen::Matrix3Xd truth(3, frames.size()), estimate = truth, smoothed = truth;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    FrameErrors& frame = frames[i];
    const SE3 now = path.at(frame.stamp, frame.estimate, Matrix6d::Zero()).world_T_imu;
    const auto column = static_cast<Eigen::Index>(i);
    truth.col(column) = frame.truth.translation();
    estimate.col(column) = frame.estimate.translation();
    smoothed.col(column) = now.translation();
    frame.smoothed = (now.translation() - frame.truth.translation()).norm();
    if (i == 0) continue; // where the world begins nothing is unknown
    while (node != path.nodes.end() && node->stamp < frame.stamp) ++node;
    if (node == path.nodes.end() || node->stamp != frame.stamp) continue;
    StateEstimate state;
    state.world_T_imu = node->now;
    state.pose_covariance = node->covariance;
    const double nees = poseNees(frame.truth, state).pose;
    sum += nees;
    result.largest_node_nees = std::fmax(result.largest_node_nees, nees);
    ++nodes;
  }
  const bool is_level = result.inertial.has_value();
  result.ate = absoluteTrajectoryError(estimate, truth, is_level);
  result.smoothed_ate = absoluteTrajectoryError(smoothed, truth, is_level);
  if (nodes > 0) result.node_nees = sum / static_cast<double>(nodes);
}

SeedResult runSeed(const Config& config, const DriveOptions& options, const InertialStudy& study) {
  if (options.hasRawImu() && config.estimator == EstimatorType::kPaper)
    throw std::invalid_argument(
        "option 'motion' is '" + std::string(nameOf(options.motion)) +
        "', allowed with estimator: paper: car or process; its map begins with the IMU's axes");
  return SeedRun(config, options, study).run();
}

} // namespace vi_ekf_slam::simulation
