#include "vi_ekf_slam/simulation/inertial/inertial_seed.hpp"

#include <optional>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/simulation/inertial/told_rig.hpp"
#include "vi_ekf_slam/simulation/inertial/trajectory.hpp"
#include "vi_ekf_slam/simulation/random.hpp"
#include "vi_ekf_slam/simulation/stale_repair.hpp"

namespace vi_ekf_slam::simulation {
namespace {

using Vector15d = Eigen::Matrix<double, 15, 1>;

/// Takes a drive through a SlamSystem and compares what comes out.
class InertialSeed {
 public:
  InertialSeed(const Config& config, const DriveOptions& options, const InertialStudy& study)
      : study_(study),
        simulator_(options),
        rig_(options.seed, simulator_.rig(), study.disturbance),
        system_(toldTheTruth(config, options)) {
    result_.seed = options.seed;
    result_.inertial.emplace();
  }

  SeedResult run() {
    system_.setRig(rig_.told());
    system_.onFrame([this](const Output& output) { compare(output); });
    system_.onReset([this](const std::string& /*reason*/, const PathEstimate& path) { end(path); });
    if (study_.start == StudyStart::kGiven)
      system_.begin(drawnStart(*simulator_.state(), simulator_.options().seed));
    StaleRepair stale;
    while (std::optional<DriveStep> step = simulator_.next()) {
      stale.repair(*step);
      if (!first_frame_) first_frame_ = step->stamp;
      if (isBlind(step->stamp)) step->frame.features.clear();
      returns_.add(step->frame);
      step->frame.stamp -= fromSeconds(rig_.timeOffset());
      for (Measurement& measurement : measurementsOf(*step)) system_.add(std::move(measurement));
    }
    system_.flush();
    result_.yaw_fall = yaw_.largestFall();
    if (!result_.inertial->begun_anew) judgePath(system_.estimator().exactMap()().path, result_);
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

  /// What comes after a reset is in another map.
  void end(const PathEstimate& path) {
    if (!result_.inertial->begun_anew) judgePath(path, result_);
    result_.inertial->begun_anew = true;
  }

  void compare(const Output& output) {
    if (result_.inertial->begun_anew) return;
    const StateEstimate& state = output.state;
    // Of a stamp that an estimated offset has moved.
    const TrueState truth = *simulator_.stateAt(state.stamp);
    if (!start_) begin(state, truth);
    const SE3 pose = map_T_world_ * truth.world_T_imu;
    if (!returns_.returned()) yaw_.add(state.pose_covariance);
    result_.frames_rejected += output.report.frame_rejected ? 1 : 0;
    result_.features += output.report.features;
    result_.features_used += output.report.used;
    result_.frames.push_back(
        frameErrors(secondsBetween(*start_, state.stamp), pose, state, output.odom_T_imu, output.report));
    countPlace(output.report, result_);
    if (!isBlind(state.stamp)) return;
    result_.inertial->blind_nees = result_.frames.back().nees.position;
    result_.inertial->blind_position = result_.frames.back().position;
  }

  void begin(const StateEstimate& state, const TrueState& truth) {
    start_ = state.stamp;
    if (study_.start == StudyStart::kSelf) map_T_world_ = mapOfTruth(truth.world_T_imu, state.world_T_imu);
    const SE3 pose = map_T_world_ * truth.world_T_imu;
    InertialOutcome& outcome = *result_.inertial;
    outcome.start_delay = secondsBetween(*first_frame_, state.stamp);
    outcome.first_pose = poseNees(pose, state).pose;
    outcome.first_tilt = tiltNees(pose, state);
    outcome.first_velocity = velocityNees(truth.world_T_imu.rotation().transpose() * truth.velocity, state);
  }

  InertialStudy study_;
  DriveSimulator simulator_;
  ToldRig rig_;
  SlamSystem system_;
  SeedResult result_;
  ReturnWatch returns_;
  YawVarianceWatch yaw_;
  std::optional<Stamp> first_frame_, start_;
  SE3 map_T_world_;
};

} // namespace

Config toldTheTruth(Config config, const DriveOptions& options) {
  InvariantConfig& filter = config.invariant;
  filter.choice = MotionChoice::kInertial;
  filter.inertial.noise = {options.gyro_density, options.accelerometer_density, options.gyro_walk,
                           options.accelerometer_walk};
  filter.inertial.noise_given = true;
  filter.inertial.accelerometer_scale_sigma = options.accelerometer_scale_sigma;
  if (options.accelerometer_bias_sigma > 0.0)
    filter.inertial.accelerometer_bias_sigma = options.accelerometer_bias_sigma;
  if (options.gyro_bias_sigma > 0.0) filter.inertial.gyro_bias_sigma = options.gyro_bias_sigma;
  filter.inertial.gravity = kGravity;
  if (options.pixel_sigma > 0.0) filter.stereo.pixel_sigma = options.pixel_sigma;
  filter.slip.sigma = 0.0;
  return config;
}

InitialState drawnStart(const TrueState& truth, std::uint64_t seed) {
  Vector15d sigma;
  sigma << Eigen::Vector3d::Constant(1e-4), 1e-3, 1e-3, 1e-4, Eigen::Vector3d::Constant(1e-2),
      Eigen::Vector3d::Constant(1e-3), Eigen::Vector3d::Constant(1e-2);
  Random random(seed, RandomStream::kStart);
  Vector15d error;
  for (Eigen::Index i = 0; i < error.size(); ++i) error[i] = sigma[i] * random.normal();
  InitialState state;
  state.stamp = truth.stamp;
  state.world_T_imu = SE3(so3::Exp(-error.segment<3>(3)) * truth.world_T_imu.rotation(),
                          truth.world_T_imu.translation() - error.head<3>());
  state.velocity = truth.velocity - error.segment<3>(6);
  state.gyro_bias = truth.gyro_bias - error.segment<3>(9);
  state.accelerometer_bias = truth.accelerometer_bias - error.tail<3>();
  state.covariance = sigma.cwiseAbs2().asDiagonal();
  return state;
}

SE3 mapOfTruth(const SE3& truth, const SE3& estimate) { return levelled(estimate, truth) * truth.inverse(); }

SeedResult runInertialSeed(const Config& config, const DriveOptions& options, const InertialStudy& study) {
  if (config.estimator == EstimatorType::kPaper)
    throw std::invalid_argument(
        "option 'motion' is '" + std::string(nameOf(options.motion)) +
        "', allowed with estimator: paper: car or process; its map begins with the IMU's axes");
  return InertialSeed(config, options, study).run();
}

} // namespace vi_ekf_slam::simulation
