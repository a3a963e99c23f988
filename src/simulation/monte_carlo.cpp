#include "vi_ekf_slam/simulation/monte_carlo.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "vi_ekf_slam/core/motion/dead_reckoning.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"
#include "vi_ekf_slam/simulation/inertial/inertial_seed.hpp"
#include "vi_ekf_slam/simulation/stale_repair.hpp"

namespace vi_ekf_slam::simulation {

namespace {

constexpr double kFartherOff = 1.0; // m, that a place taken for another one leaves the vehicle farther off

} // namespace

FrameErrors frameErrors(double time, const SE3& truth, const StateEstimate& state, const SE3& dead_reckoning,
                        const FrameReport& report) {
  FrameErrors errors;
  errors.time = time;
  errors.nees = poseNees(truth, state);
  errors.stamp = state.stamp;
  errors.estimate = state.world_T_imu;
  errors.truth = truth;
  errors.position = (errors.estimate.translation() - truth.translation()).norm();
  errors.dead_reckoning = (dead_reckoning.translation() - truth.translation()).norm();
  errors.yaw_sigma = std::sqrt(std::max(0.0, state.pose_covariance(5, 5)));
  errors.nis = report.nis;
  errors.nis_dof = report.nis_dof;
  errors.revisited = report.revisited;
  return errors;
}

std::size_t checkPointFrame(double share, std::size_t frames) {
  return static_cast<std::size_t>(std::lround(share * static_cast<double>(frames - 1)));
}

DriveOptions studyOptions(MotionModel motion) {
  DriveOptions options;
  options.motion = motion;
  if (motion == MotionModel::kCarDrive) return options;
  if (options.hasRawImu()) {
    options.standing_start = 3.0;
    options.gyro_bias_sigma = 0.005;
    options.stale_fraction = 0.0;
    if (motion == MotionModel::kInertialCar) return options;
    options.duration = 60.0;
    options.frame_rate = 20.0;
    options.features_max = 250;
    options.features_min = 180;
    options.moving_objects = 0;
    options.min_depth = 0.6;
    options.max_depth = 40.0;
    return options;
  }
  options.duration = 100.0;
  // The default filter's own model of motion, biases and noise: any other would test the model, not the
  // filter.
  const InvariantConfig filter;
  options.noise_forward = filter.motion.twist_density[0];
  options.noise_lateral = filter.motion.twist_density[1];
  options.noise_vertical = filter.motion.twist_density[2];
  options.noise_rotation = filter.motion.twist_density[3];
  options.gyro_bias_sigma = filter.motion.prior_bias_sigma[3];
  options.pixel_sigma = filter.stereo.pixel_sigma;
  options.outlier_fraction = options.stale_fraction = 0.0;
  options.moving_objects = 0;
  return options;
}

void countPlace(const FrameReport& report, SeedResult& result) {
  if (!report.place_recognised) return;
  ++result.places;
  const std::size_t now = result.frames.size() - 1;
  const double before = now > 0 ? result.frames[now - 1].position : 0.0;
  if (result.frames[now].position > before + kFartherOff) ++result.wrong_places;
}

void judgePath(const PathEstimate& path, SeedResult& result) {
  std::vector<FrameErrors>& frames = result.frames;
  std::size_t nodes = 0, next = 0;
  double sum = 0.0;
  Eigen::Matrix3Xd truth(3, frames.size()), smoothed = truth;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    FrameErrors& frame = frames[i];
    const SE3 now = path.at(frame.stamp, frame.estimate, Matrix6d::Zero()).world_T_imu;
    const auto column = static_cast<Eigen::Index>(i);
    truth.col(column) = frame.truth.translation();
    smoothed.col(column) = now.translation();
    frame.smoothed = (now.translation() - frame.truth.translation()).norm();
    while (next < path.nodes.size() && path.nodes[next].stamp < frame.stamp) ++next;
    if (next == path.nodes.size() || path.nodes[next].stamp != frame.stamp) continue;
    StateEstimate node;
    node.world_T_imu = path.nodes[next].now;
    node.pose_covariance = path.nodes[next].covariance;
    if (frame.stamp == frames.front().stamp) continue; // where the world begins nothing is unknown
    const double nees = poseNees(frame.truth, node).pose;
    sum += nees;
    result.largest_node_nees = std::fmax(result.largest_node_nees, nees);
    ++nodes;
  }
  if (!frames.empty())
    result.smoothed_ate = absoluteTrajectoryError(smoothed, truth, result.inertial.has_value());
  if (nodes > 0) result.node_nees = sum / static_cast<double>(nodes);
}

SeedResult runSeed(const Config& config, const DriveOptions& options, const InertialStudy& study) {
  if (options.hasRawImu()) return runInertialSeed(config, options, study);
  DriveSimulator simulator(options);
  const std::unique_ptr<Estimator> estimator = makeEstimator(config);
  estimator->setRig(simulator.rig());
  DeadReckoning dead_reckoning;
  StaleRepair stale;
  ReturnWatch returns;
  YawVarianceWatch yaw;
  SeedResult result;
  result.seed = options.seed;
  std::optional<Stamp> start;
  while (std::optional<DriveStep> step = simulator.next()) {
    stale.repair(*step);
    if (!start) start = step->stamp;
    for (const Measurement& measurement : measurementsOf(*step)) {
      if (const auto* gyro = std::get_if<ImuSample>(&measurement)) {
        estimator->process(*gyro);
        dead_reckoning.process(*gyro);
      } else if (const auto* velocity = std::get_if<VelocitySample>(&measurement)) {
        estimator->process(*velocity);
        dead_reckoning.process(*velocity);
      } else {
        const FrameReport report = estimator->process(step->frame);
        dead_reckoning.advanceTo(step->stamp);
        const StateEstimate state = estimator->state();
        returns.add(step->frame);
        if (!returns.returned()) yaw.add(state.pose_covariance);
        result.frames_rejected += report.frame_rejected ? 1 : 0;
        result.features += report.features;
        result.features_used += report.used;
        result.frames.push_back(frameErrors(secondsBetween(*start, step->stamp), step->world_T_imu, state,
                                            dead_reckoning.pose(), report));
        countPlace(report, result);
      }
    }
  }
  result.yaw_fall = yaw.largestFall();
  judgePath(estimator->exactMap()().path, result);
  return result;
}

std::vector<SeedResult> runSeeds(const Config& config, const DriveOptions& options, std::uint64_t first,
                                 std::size_t count, unsigned jobs,
                                 const std::function<void(std::size_t)>& progress,
                                 const InertialStudy& study) {
  std::vector<SeedResult> results(count);
  std::atomic<std::size_t> next{0};
  std::atomic<bool> failed{false};
  std::mutex mutex;
  std::size_t done = 0;
  std::exception_ptr failure;
  const auto work = [&] {
    try {
      for (std::size_t i = next++; i < count && !failed; i = next++) {
        DriveOptions of_seed = options;
        of_seed.seed = first + i;
        results[i] = runSeed(config, of_seed, study);
        const std::lock_guard<std::mutex> lock(mutex);
        ++done;
        if (progress) progress(done);
      }
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (!failure) failure = std::current_exception();
      failed = true;
    }
  };
  std::vector<std::thread> threads;
  for (unsigned job = 1; job < jobs && job < count; ++job) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
  return results;
}

std::vector<SeedResult> startedOf(std::vector<SeedResult> results) {
  const auto never = [](const SeedResult& result) { return result.frames.empty(); };
  results.erase(std::remove_if(results.begin(), results.end(), never), results.end());
  return results;
}

std::vector<MeanErrors> meansByFrame(const std::vector<SeedResult>& all) {
  const std::vector<SeedResult> results = startedOf(all);
  std::vector<MeanErrors> means;
  if (results.empty()) return means;
  std::size_t frames = results.front().frames.size();
  for (const SeedResult& result : results) frames = std::min(frames, result.frames.size());
  const double n = static_cast<double>(results.size());
  for (std::size_t k = 0; k < frames; ++k) {
    MeanErrors mean;
    double nis = 0.0, dof = 0.0;
    for (const SeedResult& result : results) {
      const FrameErrors& errors = result.frames[k];
      mean.time = errors.time;
      mean.nees.pose += errors.nees.pose / n;
      mean.nees.rotation += errors.nees.rotation / n;
      mean.nees.position += errors.nees.position / n;
      mean.position_rmse += errors.position * errors.position / n;
      mean.dead_reckoning_rmse += errors.dead_reckoning * errors.dead_reckoning / n;
      nis += errors.nis;
      dof += static_cast<double>(errors.nis_dof);
    }
    mean.position_rmse = std::sqrt(mean.position_rmse);
    mean.dead_reckoning_rmse = std::sqrt(mean.dead_reckoning_rmse);
    mean.nis_per_dof = nis / dof; // not a number where nothing was used
    means.push_back(mean);
  }
  return means;
}

double rmse(const SeedResult& result, double FrameErrors::*member) {
  double sum = 0.0;
  for (const FrameErrors& errors : result.frames) sum += errors.*member * errors.*member;
  return std::sqrt(sum / static_cast<double>(result.frames.size()));
}

double ate(const SeedResult& result) {
  if (result.frames.empty()) return InertialOutcome::kNever;
  Eigen::Matrix3Xd estimate(3, result.frames.size()), truth = estimate;
  for (std::size_t i = 0; i < result.frames.size(); ++i) {
    estimate.col(static_cast<Eigen::Index>(i)) = result.frames[i].estimate.translation();
    truth.col(static_cast<Eigen::Index>(i)) = result.frames[i].truth.translation();
  }
  return absoluteTrajectoryError(estimate, truth, result.inertial.has_value());
}

double nisPerDof(const SeedResult& result) {
  double nis = 0.0, dof = 0.0;
  for (const FrameErrors& errors : result.frames) {
    nis += errors.nis;
    dof += static_cast<double>(errors.nis_dof);
  }
  return nis / dof;
}

} // namespace vi_ekf_slam::simulation
