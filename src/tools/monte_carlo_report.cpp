#include "monte_carlo_report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "vi_ekf_slam/core/run/atomic_file.hpp"

namespace vi_ekf_slam {

using simulation::FrameErrors;
using simulation::MeanErrors;
using simulation::PoseNees;
using simulation::SeedResult;

namespace {

__attribute__((format(printf, 1, 2))) std::string format(const char* pattern, ...) {
  char buffer[512];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, arguments);
  va_end(arguments);
  return buffer;
}

double frameMean(const std::vector<SeedResult>& results, double (*value)(const SeedResult&)) {
  double sum = 0.0;
  for (const SeedResult& result : results) sum += value(result);
  return sum / static_cast<double>(results.size());
}

/// Means over the seeds at a check point, each drive at its own frame.
PoseNees meanNees(const std::vector<SeedResult>& results, double share) {
  PoseNees mean;
  for (const SeedResult& result : results) {
    const PoseNees& nees = result.frames[simulation::checkPointFrame(share, result.frames.size())].nees;
    mean.pose += nees.pose / static_cast<double>(results.size());
    mean.rotation += nees.rotation / static_cast<double>(results.size());
    mean.position += nees.position / static_cast<double>(results.size());
  }
  return mean;
}

/// What is said of a study in a line.
struct RateFigures {
  std::vector<double> nees; ///< of the pose, at the check points
  double nis_per_dof = 0.0, position_rmse = 0.0, dead_reckoning_rmse = 0.0;
};

RateFigures figuresOf(const RateStudy& study) {
  RateFigures figures;
  for (const double share : simulation::kCheckPoints)
    figures.nees.push_back(meanNees(study.results, share).pose);
  figures.nis_per_dof = frameMean(study.results, [](const SeedResult& r) { return nisPerDof(r); });
  figures.position_rmse =
      frameMean(study.results, [](const SeedResult& r) { return rmse(r, &FrameErrors::position); });
  figures.dead_reckoning_rmse =
      frameMean(study.results, [](const SeedResult& r) { return rmse(r, &FrameErrors::dead_reckoning); });
  return figures;
}

std::string seedsCsv(const std::vector<SeedResult>& results) {
  std::string text =
      "seed,frames,nis_per_dof,yaw_variance_fall,position_rmse,dead_reckoning_rmse,final_position_error,"
      "features,features_used,frames_rejected\n";
  for (const SeedResult& r : results) {
    text += format("%llu,%zu,%.6g,%.6g,%.6g,%.6g,%.6g,%zu,%zu,%zu\n", static_cast<unsigned long long>(r.seed),
                   r.frames.size(), nisPerDof(r), r.yaw_fall, rmse(r, &FrameErrors::position),
                   rmse(r, &FrameErrors::dead_reckoning), r.frames.back().position, r.features,
                   r.features_used, r.frames_rejected);
  }
  return text;
}

std::string checkPointsCsv(const std::vector<SeedResult>& results) {
  std::string text =
      "seed,share,time,nees,nees_rotation,nees_position,position_error,dead_reckoning_error,yaw_sigma\n";
  for (const SeedResult& r : results) {
    for (const double share : simulation::kCheckPoints) {
      const FrameErrors& f = r.frames[simulation::checkPointFrame(share, r.frames.size())];
      text += format("%llu,%.2f,%.3f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n",
                     static_cast<unsigned long long>(r.seed), share, f.time, f.nees.pose, f.nees.rotation,
                     f.nees.position, f.position, f.dead_reckoning, f.yaw_sigma);
    }
  }
  return text;
}

std::string framesCsv(const std::vector<SeedResult>& results) {
  const double n = static_cast<double>(results.size());
  const auto [low6, high6] = simulation::chiSquareMeanBounds(6.0, n);
  const auto [low3, high3] = simulation::chiSquareMeanBounds(3.0, n);
  std::string text =
      "time,nees,nees_rotation,nees_position,nis_per_dof,position_rmse,dead_reckoning_rmse,bound_low_6,bound_"
      "high_6,"
      "bound_low_3,bound_high_3\n";
  for (const MeanErrors& mean : simulation::meansByFrame(results)) {
    text += format("%.3f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", mean.time, mean.nees.pose,
                   mean.nees.rotation, mean.nees.position, mean.nis_per_dof, mean.position_rmse,
                   mean.dead_reckoning_rmse, low6, high6, low3, high3);
  }
  return text;
}

} // namespace

void writeMonteCarlo(const std::string& directory, const std::vector<SeedResult>& results) {
  writeFile(directory + "/seeds.csv", seedsCsv(results));
  writeFile(directory + "/check_points.csv", checkPointsCsv(results));
  writeFile(directory + "/frames.csv", framesCsv(results));
}

std::string monteCarloSummary(const std::vector<SeedResult>& results) {
  const double n = static_cast<double>(results.size());
  const auto [low6, high6] = simulation::chiSquareMeanBounds(6.0, n);
  const auto [low3, high3] = simulation::chiSquareMeanBounds(3.0, n);
  std::string text = format("%zu seeds, mean NEES (right-invariant coordinates)\n", results.size());
  text += "  of the drive      pose   rotation   position\n";
  for (const double share : simulation::kCheckPoints) {
    const PoseNees mean = meanNees(results, share);
    text +=
        format("  %8.0f %%   %9.3f  %9.3f  %9.3f\n", 100.0 * share, mean.pose, mean.rotation, mean.position);
  }
  text += format("  expected     %9.3f  %9.3f  %9.3f\n", 6.0, 3.0, 3.0);
  text += format("  95 %% bounds  %4.2f-%4.2f  %4.2f-%4.2f  %4.2f-%4.2f\n", low6, high6, low3, high3, low3,
                 high3);
  double nis = 0.0, dof = 0.0, fall = 0.0;
  std::size_t rejected = 0;
  for (const SeedResult& result : results) {
    fall = std::max(fall, result.yaw_fall);
    rejected += result.frames_rejected;
    for (const FrameErrors& frame : result.frames) {
      nis += frame.nis;
      dof += static_cast<double>(frame.nis_dof);
    }
  }
  text += format("NIS per degree of freedom    %.4f (%.0f degrees)\n", nis / dof, dof);
  text += format("global yaw variance falls by %.3g %% at most from one frame to the next\n", 100.0 * fall);
  text +=
      format("position RMSE                %.3f m (dead reckoning %.3f m), means over the seeds\n",
             frameMean(results, [](const SeedResult& r) { return rmse(r, &FrameErrors::position); }),
             frameMean(results, [](const SeedResult& r) { return rmse(r, &FrameErrors::dead_reckoning); }));
  text += format("final position error         %.3f m (dead reckoning %.3f m)\n",
                 frameMean(results, [](const SeedResult& r) { return r.frames.back().position; }),
                 frameMean(results, [](const SeedResult& r) { return r.frames.back().dead_reckoning; }));
  text += format("frames rejected              %zu\n", rejected);
  return text;
}

std::string ratesSummary(const std::vector<RateStudy>& studies) {
  const std::size_t seeds = studies.front().results.size();
  const auto [low, high] = simulation::chiSquareMeanBounds(6.0, static_cast<double>(seeds));
  std::string text =
      format("%zu seeds, mean pose NEES (expected 6.00, 95 %% bounds %.2f-%.2f)\n", seeds, low, high);
  text += "  frames Hz  imu Hz      25 %      50 %      75 %     100 %   NIS/dof  RMSE m  dead reckoning m\n";
  for (const RateStudy& study : studies) {
    const RateFigures figures = figuresOf(study);
    text += format("  %9g %7g ", study.drive.frame_rate, study.drive.imuRate());
    for (const double nees : figures.nees) text += format(" %9.2f", nees);
    text += format("  %8.3f %7.2f  %16.2f\n", figures.nis_per_dof, figures.position_rmse,
                   figures.dead_reckoning_rmse);
  }
  return text;
}

void writeRates(const std::string& directory, const std::vector<RateStudy>& studies) {
  std::string text =
      "frame_rate,imu_rate,nees_25,nees_50,nees_75,nees_100,nis_per_dof,position_rmse,dead_reckoning_rmse\n";
  for (const RateStudy& study : studies) {
    const RateFigures figures = figuresOf(study);
    text += format("%g,%g", study.drive.frame_rate, study.drive.imuRate());
    for (const double nees : figures.nees) text += format(",%.6g", nees);
    text +=
        format(",%.6g,%.6g,%.6g\n", figures.nis_per_dof, figures.position_rmse, figures.dead_reckoning_rmse);
  }
  writeFile(directory + "/rates.csv", text);
}

bool neesWithin(const std::vector<SeedResult>& results, const std::pair<double, double>& bounds) {
  return std::all_of(simulation::kCheckPoints.begin(), simulation::kCheckPoints.end(), [&](double share) {
    const double nees = meanNees(results, share).pose;
    return nees >= bounds.first && nees <= bounds.second; // false for not a number
  });
}

} // namespace vi_ekf_slam
