#include "monte_carlo_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "vi_ekf_slam/core/run/atomic_file.hpp"

namespace vi_ekf_slam {

using simulation::FrameErrors;
using simulation::InertialOutcome;
using simulation::MeanErrors;
using simulation::PoseNees;
using simulation::SeedResult;

namespace {

constexpr double kSoon = 2.0;        // s, after which a start is late
constexpr double kWrongStart = 12.6; // chi-square, 6 degrees of freedom, 95 %

__attribute__((format(printf, 1, 2))) std::string format(const char* pattern, ...) {
  char buffer[512];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, arguments);
  va_end(arguments);
  return buffer;
}

/// Over the seeds that have an estimate; not a number without any.
template <typename Value>
double meanOf(const std::vector<SeedResult>& results, const Value& value) {
  double sum = 0.0, n = 0.0;
  for (const SeedResult& result : results) {
    if (result.frames.empty()) continue;
    sum += value(result);
    n += 1.0;
  }
  return sum / n;
}

double meanRmse(const std::vector<SeedResult>& results, double FrameErrors::*error) {
  return meanOf(results, [error](const SeedResult& r) { return rmse(r, error); });
}

const FrameErrors& atCheckPoint(const SeedResult& result, double share) {
  return result.frames[simulation::checkPointFrame(share, result.frames.size())];
}

double meanNees(const std::vector<SeedResult>& results, double share,
                double PoseNees::*nees = &PoseNees::pose) {
  return meanOf(results, [=](const SeedResult& r) { return atCheckPoint(r, share).nees.*nees; });
}

std::size_t revisitedIn(const SeedResult& result) {
  std::size_t sum = 0;
  for (const FrameErrors& frame : result.frames) sum += frame.revisited;
  return sum;
}

std::string seedsCsv(const std::vector<SeedResult>& results) {
  std::string text =
      "seed,frames,nis_per_dof,yaw_variance_fall,position_rmse,dead_reckoning_rmse,final_position_error,"
      "features,features_used,frames_rejected,places,wrong_places,revisited,smoothed_rmse,node_nees,"
      "largest_node_nees,ate,smoothed_ate\n";
  for (const SeedResult& r : results) {
    text += format("%llu,%zu,%.6g,%.6g,%.6g,%.6g,%.6g,%zu,%zu,%zu,%zu,%zu,%zu,%.6g,%.6g,%.6g,%.6g,%.6g\n",
                   static_cast<unsigned long long>(r.seed), r.frames.size(), nisPerDof(r), r.yaw_fall,
                   rmse(r, &FrameErrors::position), rmse(r, &FrameErrors::dead_reckoning),
                   r.frames.empty() ? InertialOutcome::kNever : r.frames.back().position, r.features,
                   r.features_used, r.frames_rejected, r.places, r.wrong_places, revisitedIn(r),
                   rmse(r, &FrameErrors::smoothed), r.node_nees, r.largest_node_nees, r.ate, r.smoothed_ate);
  }
  return text;
}

std::string checkPointsCsv(const std::vector<SeedResult>& results) {
  std::string text =
      "seed,share,time,nees,nees_rotation,nees_position,position_error,dead_reckoning_error,yaw_sigma\n";
  for (const SeedResult& r : results) {
    if (r.frames.empty()) continue;
    for (const double share : simulation::kCheckPoints) {
      const FrameErrors& f = atCheckPoint(r, share);
      text += format("%llu,%.2f,%.3f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n",
                     static_cast<unsigned long long>(r.seed), share, f.time, f.nees.pose, f.nees.rotation,
                     f.nees.position, f.position, f.dead_reckoning, f.yaw_sigma);
    }
  }
  return text;
}

std::string framesCsv(const std::vector<SeedResult>& results) {
  const double n = static_cast<double>(simulation::startedOf(results).size());
  const auto [low6, high6] = simulation::chiSquareMeanBounds(6.0, n);
  const auto [low3, high3] = simulation::chiSquareMeanBounds(3.0, n);
  std::string text =
      "time,nees,nees_rotation,nees_position,nis_per_dof,position_rmse,dead_reckoning_rmse,"
      "bound_low_6,bound_high_6,bound_low_3,bound_high_3\n";
  for (const MeanErrors& mean : simulation::meansByFrame(results)) {
    text += format("%.3f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", mean.time, mean.nees.pose,
                   mean.nees.rotation, mean.nees.position, mean.nis_per_dof, mean.position_rmse,
                   mean.dead_reckoning_rmse, low6, high6, low3, high3);
  }
  return text;
}

bool isInertial(const std::vector<SeedResult>& results) {
  return !results.empty() && results.front().inertial;
}

std::string startsCsv(const std::vector<SeedResult>& results) {
  std::string text =
      "seed,start_delay,first_nees,first_nees_tilt,first_nees_velocity,blind_nees_position,blind_position_"
      "error\n";
  for (const SeedResult& r : results) {
    const InertialOutcome& o = *r.inertial;
    text +=
        format("%llu,%.3f,%.6g,%.6g,%.6g,%.6g,%.6g\n", static_cast<unsigned long long>(r.seed), o.start_delay,
               o.first_pose, o.first_tilt, o.first_velocity, o.blind_nees, o.blind_position);
  }
  return text;
}

/// Of what is a number.
struct Figures {
  std::size_t count = 0;
  double mean = InertialOutcome::kNever, most = InertialOutcome::kNever;
};

Figures figuresOf(const std::vector<SeedResult>& results, double InertialOutcome::*member) {
  Figures figures;
  double sum = 0.0;
  for (const SeedResult& result : results) {
    const double value = (*result.inertial).*member;
    if (std::isnan(value)) continue;
    ++figures.count;
    sum += value;
    figures.mean = sum / static_cast<double>(figures.count);
    figures.most = std::fmax(figures.most, value);
  }
  return figures;
}

/// Of those that do not count to their end; empty: there are none.
std::string anewSummary(const std::vector<SeedResult>& results) {
  const auto anew = std::count_if(results.begin(), results.end(),
                                  [](const SeedResult& result) { return result.begun_anew; });
  if (anew == 0) return {};
  return format(
      "begun anew                   %lld of %zu seeds, after a gap or since IMU and pictures contradict each "
      "other; they count up to there\n",
      static_cast<long long>(anew), results.size());
}

std::string startsSummary(const std::vector<SeedResult>& results) {
  const Figures delay = figuresOf(results, &InertialOutcome::start_delay);
  const auto soon = std::count_if(results.begin(), results.end(), [](const SeedResult& result) {
    return result.inertial->start_delay <= kSoon;
  });
  const double n = static_cast<double>(results.size());
  std::string text = format("not started at all           %.0f %%, not within %.0f s %.0f %%\n",
                            100.0 * (1.0 - static_cast<double>(delay.count) / n), kSoon,
                            100.0 * (1.0 - static_cast<double>(soon) / n));
  text += format("start delay                  %.2f s, at most %.2f s\n", delay.mean, delay.most);
  text +=
      format("first estimate's mean NEES   pose %.2f, tilt %.2f (2 expected), velocity %.2f (3 expected)\n",
             figuresOf(results, &InertialOutcome::first_pose).mean,
             figuresOf(results, &InertialOutcome::first_tilt).mean,
             figuresOf(results, &InertialOutcome::first_velocity).mean);
  const auto wrong = std::count_if(results.begin(), results.end(), [](const SeedResult& result) {
    return result.inertial->first_tilt + result.inertial->first_velocity > kWrongStart;
  });
  text += format("first estimates beyond %.1f  %lld of %zu (tilt and velocity, without their correlation)\n",
                 kWrongStart, static_cast<long long>(wrong), delay.count);
  const Figures blind = figuresOf(results, &InertialOutcome::blind_nees);
  if (blind.count == 0) return text;
  const auto [low, high] = simulation::chiSquareMeanBounds(3.0, static_cast<double>(blind.count));
  return text + format(
                    "end of the blind time        position NEES %.2f (3 expected, 95 %% bounds %.2f-%.2f), "
                    "error %.3f m\n",
                    blind.mean, low, high, figuresOf(results, &InertialOutcome::blind_position).mean);
}

constexpr std::array<const char*, 8> kRigParts = {"rotation x, rad",  "rotation y, rad",  "rotation z, rad",
                                                  "translation x, m", "translation y, m", "translation z, m",
                                                  "time offset, s",   "scale, 1"};

bool isDisturbed(const std::vector<SeedResult>& results) {
  return isInertial(results) && std::any_of(results.begin(), results.end(), [](const SeedResult& r) {
           return !std::isnan(r.inertial->rig.front().before);
         });
}

std::string rigCsv(const std::vector<SeedResult>& results) {
  std::string text = "seed,part,error_before,error_after,sigma\n";
  for (const SeedResult& r : results) {
    for (std::size_t i = 0; i < kRigParts.size(); ++i) {
      const auto& part = r.inertial->rig[i];
      text += format("%llu,\"%s\",%.6g,%.6g,%.6g\n", static_cast<unsigned long long>(r.seed), kRigParts[i],
                     part.before, part.after, part.sigma);
    }
  }
  return text;
}

/// RMS over the seeds, and how many are within three standard deviations.
std::string rigSummary(const std::vector<SeedResult>& results) {
  const auto judged = std::count_if(results.begin(), results.end(), [](const SeedResult& r) {
    return !std::isnan(r.inertial->rig.front().before);
  });
  std::string text = format(
      "the rig that it was told, of %lld of %zu seeds (the others have no estimate at the end): "
      "RMS error before, after, stated sigma, seeds within 3 sigma\n",
      static_cast<long long>(judged), results.size());
  for (std::size_t i = 0; i < kRigParts.size(); ++i) {
    double before = 0.0, after = 0.0, variance = 0.0, n = 0.0, within = 0.0;
    for (const SeedResult& r : results) {
      const auto& part = r.inertial->rig[i];
      if (std::isnan(part.before)) continue;
      n += 1.0;
      before += part.before * part.before;
      after += part.after * part.after;
      variance += part.sigma * part.sigma;
      within += std::abs(part.after) <= 3.0 * part.sigma ? 1.0 : 0.0;
    }
    text += format("  %-18s %9.6f %9.6f %9.6f   %.0f of %.0f\n", kRigParts[i], std::sqrt(before / n),
                   std::sqrt(after / n), std::sqrt(variance / n), within, n);
  }
  return text;
}

std::string neesSummary(const std::vector<SeedResult>& results) {
  const double n = static_cast<double>(simulation::startedOf(results).size());
  const auto [low6, high6] = simulation::chiSquareMeanBounds(6.0, n);
  const auto [low3, high3] = simulation::chiSquareMeanBounds(3.0, n);
  std::string text = format("%zu seeds, mean NEES (right-invariant coordinates)\n", results.size());
  text += "  of the drive      pose   rotation   position\n";
  for (const double share : simulation::kCheckPoints)
    text +=
        format("  %8.0f %%   %9.3f  %9.3f  %9.3f\n", 100.0 * share, meanNees(results, share),
               meanNees(results, share, &PoseNees::rotation), meanNees(results, share, &PoseNees::position));
  text += format("  expected     %9.3f  %9.3f  %9.3f\n", 6.0, 3.0, 3.0);
  return text + format("  95 %% bounds  %4.2f-%4.2f  %4.2f-%4.2f  %4.2f-%4.2f\n", low6, high6, low3, high3,
                       low3, high3);
}

/// Of a study of one pair of rates: mean pose NEES at the check points, then NIS per degree of freedom, RMSE
/// of the position and of dead reckoning in m.
std::vector<double> rateFigures(const std::vector<SeedResult>& results) {
  std::vector<double> figures;
  for (const double share : simulation::kCheckPoints) figures.push_back(meanNees(results, share));
  figures.push_back(meanOf(results, simulation::nisPerDof));
  figures.push_back(meanRmse(results, &FrameErrors::position));
  figures.push_back(meanRmse(results, &FrameErrors::dead_reckoning));
  return figures;
}

/// Of all seeds, or where it says so those with an estimate.
std::string errorsSummary(const std::vector<SeedResult>& results) {
  double nis = 0.0, dof = 0.0, fall = 0.0, largest = InertialOutcome::kNever;
  std::size_t rejected = 0, places = 0, wrong = 0, with_places = 0, revisited = 0;
  for (const SeedResult& result : results) {
    fall = std::max(fall, result.yaw_fall);
    rejected += result.frames_rejected;
    places += result.places;
    wrong += result.wrong_places;
    with_places += result.places > 0 ? 1 : 0;
    revisited += revisitedIn(result);
    largest = std::fmax(largest, result.largest_node_nees);
    for (const FrameErrors& frame : result.frames) {
      nis += frame.nis;
      dof += static_cast<double>(frame.nis_dof);
    }
  }
  const double started = static_cast<double>(simulation::startedOf(results).size());
  const auto last = [](double FrameErrors::*error) {
    return [error](const SeedResult& r) { return r.frames.back().*error; };
  };
  std::string text = format("NIS per degree of freedom    %.4f (%.0f degrees)\n", nis / dof, dof);
  text += format("global yaw variance falls by %.3g %% at most from one frame to the next\n", 100.0 * fall);
  text += format("position RMSE                %.3f m (dead reckoning %.3f m), means over the seeds\n",
                 meanRmse(results, &FrameErrors::position), meanRmse(results, &FrameErrors::dead_reckoning));
  text += format("ATE                          %.3f m, after %s alignment\n",
                 meanOf(results, [](const SeedResult& r) { return r.ate; }),
                 isInertial(results) ? "yaw and translation" : "rigid");
  text += format("final position error         %.3f m (dead reckoning %.3f m)\n",
                 meanOf(results, last(&FrameErrors::position)),
                 meanOf(results, last(&FrameErrors::dead_reckoning)));
  text += format(
      "its RMS                      %.3f m\n",
      std::sqrt(meanOf(results, [](const SeedResult& r) { return std::pow(r.frames.back().position, 2); })));
  text += format("frames rejected              %zu\n", rejected);
  text += format("places recognised            on %zu drives, %zu in all, %zu of them wrong\n", with_places,
                 places, wrong);
  text += format("landmarks found again        %.1f a drive\n", static_cast<double>(revisited) / started);
  text += format("smoothed path, RMSE          %.3f m; NEES of its nodes %.3f, %.1f at most\n",
                 meanRmse(results, &FrameErrors::smoothed),
                 meanOf(results, [](const SeedResult& r) { return r.node_nees; }), largest);
  return text + format("its ATE                      %.3f m, after the same alignment\n",
                       meanOf(results, [](const SeedResult& r) { return r.smoothed_ate; }));
}

} // namespace

void writeMonteCarlo(const std::string& directory, const std::vector<SeedResult>& results) {
  writeFile(directory + "/seeds.csv", seedsCsv(results));
  writeFile(directory + "/check_points.csv", checkPointsCsv(results));
  writeFile(directory + "/frames.csv", framesCsv(results));
  if (isInertial(results)) writeFile(directory + "/starts.csv", startsCsv(results));
  if (isDisturbed(results)) writeFile(directory + "/rig.csv", rigCsv(results));
}

std::string monteCarloSummary(const std::vector<SeedResult>& results) {
  const std::string text = neesSummary(results) + errorsSummary(results) + anewSummary(results);
  const std::string starts = isInertial(results) ? startsSummary(results) : "";
  return text + starts + (isDisturbed(results) ? rigSummary(results) : "");
}

std::string ratesSummary(const std::vector<RateStudy>& studies) {
  const std::size_t seeds = studies.front().results.size();
  const auto [low, high] = simulation::chiSquareMeanBounds(6.0, static_cast<double>(seeds));
  std::string text =
      format("%zu seeds, mean pose NEES (expected 6.00, 95 %% bounds %.2f-%.2f)\n", seeds, low, high);
  text += "  frames Hz  imu Hz      25 %      50 %      75 %     100 %   NIS/dof  RMSE m  dead reckoning m\n";
  for (const auto& [drive, results] : studies) {
    const std::vector<double> f = rateFigures(results);
    text += format("  %9g %7g  %9.2f %9.2f %9.2f %9.2f  %8.3f %7.2f  %16.2f\n", drive.frame_rate,
                   drive.imuRate(), f[0], f[1], f[2], f[3], f[4], f[5], f[6]);
    text += anewSummary(results);
  }
  return text;
}

void writeRates(const std::string& directory, const std::vector<RateStudy>& studies) {
  std::string text =
      "frame_rate,imu_rate,nees_25,nees_50,nees_75,nees_100,nis_per_dof,position_rmse,dead_reckoning_rmse\n";
  for (const auto& [drive, results] : studies) {
    text += format("%g,%g", drive.frame_rate, drive.imuRate());
    for (const double figure : rateFigures(results)) text += format(",%.6g", figure);
    text += "\n";
  }
  writeFile(directory + "/rates.csv", text);
}

bool neesWithin(const std::vector<SeedResult>& results, const std::pair<double, double>& bounds) {
  return std::all_of(simulation::kCheckPoints.begin(), simulation::kCheckPoints.end(), [&](double share) {
    const double nees = meanNees(results, share);
    return nees >= bounds.first && nees <= bounds.second; // false for not a number
  });
}

} // namespace vi_ekf_slam
