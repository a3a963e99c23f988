#include "vi_ekf_slam/simulation/monte_carlo.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <mutex>
#include <thread>

namespace vi_ekf_slam::simulation {

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

double nisPerDof(const SeedResult& result) {
  double nis = 0.0, dof = 0.0;
  for (const FrameErrors& errors : result.frames) {
    nis += errors.nis;
    dof += static_cast<double>(errors.nis_dof);
  }
  return nis / dof;
}

} // namespace vi_ekf_slam::simulation
