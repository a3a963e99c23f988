#include "vi_ekf_slam/core/run/run_writer.hpp"

#include <unistd.h>

#include <Eigen/Geometry>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <numeric>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/run/atomic_file.hpp"
#include "vi_ekf_slam/core/run/calibration_files.hpp"

namespace vi_ekf_slam {
namespace {

namespace fs = std::filesystem;

constexpr const char* kCovarianceHeader =
    "stamp,xx,xy,xz,xa,xb,xc,yy,yz,ya,yb,yc,zz,za,zb,zc,aa,ab,ac,bb,bc,cc\n";

/// printf into a string.
template <typename... Args>
std::string format(const char* pattern, Args... args) {
  std::string text(160, '\0'); // a line, mostly
  const auto size = static_cast<std::size_t>(std::snprintf(text.data(), text.size(), pattern, args...));
  if (size >= text.size()) {
    text.resize(size + 1);
    std::snprintf(text.data(), text.size(), pattern, args...);
  }
  text.resize(size);
  return text;
}

std::string pathIn(const std::string& directory, const char* name) {
  return (fs::path(directory) / name).string();
}

std::array<double, 12> toNumbers(const SE3& pose) {
  std::array<double, 12> numbers{};
  Eigen::Map<Eigen::Matrix<double, 3, 4>>(numbers.data()) << pose.rotation(), pose.translation();
  return numbers;
}

SE3 toPose(const std::array<double, 12>& numbers) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 4>> matrix(numbers.data());
  return {matrix.leftCols<3>(), matrix.col(3)};
}

RunRecord toRecord(const Output& o) {
  RunRecord record{o.state.stamp, toNumbers(o.state.world_T_imu), toNumbers(o.odom_T_imu), {}, o.report,
                   o.update_s};
  Eigen::Map<Matrix6d>(record.pose_covariance.data()) = o.state.pose_covariance;
  return record;
}

std::string tumLine(Stamp stamp, const SE3& pose) {
  Eigen::Quaterniond q(pose.rotation());
  if (q.w() < 0.0) q.coeffs() = -q.coeffs();
  const Eigen::Vector3d& t = pose.translation();
  return stampText(stamp) +
         format(" %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n", t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
}

template <typename Derived>
std::string upperTriangle(const Eigen::MatrixBase<Derived>& m) {
  std::string text;
  for (Eigen::Index row = 0; row < m.rows(); ++row) {
    for (Eigen::Index col = row; col < m.cols(); ++col) text += format(",%.17g", m(row, col));
  }
  return text;
}

std::string frameLine(const FrameReport& r, double update_s) {
  return stampText(r.stamp) + format(",%zu,%zu,%zu,%zu,%zu,%zu,%zu,%d,%.9g,%zu,%.3f\n", r.features, r.invalid,
                                     r.used, r.rejected, r.initialised, r.removed, r.landmarks,
                                     r.frame_rejected ? 1 : 0, r.nis, r.nis_dof, 1e3 * update_s);
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c == '\n' ? ' ' : c;
  }
  return out + '"';
}

std::string list(const std::vector<std::size_t>& numbers) {
  std::string text = "[";
  for (const std::size_t number : numbers) text += (text.size() > 1 ? ", " : "") + std::to_string(number);
  return text + "]";
}

/// A line `key: {total: ..., name: count, ...}`, of the counts from `first` on.
template <std::size_t N>
std::string countsLine(const char* key, const std::array<const char*, N>& names,
                       const std::array<std::uint64_t, N>& counts, std::size_t first = 0) {
  std::ostringstream text;
  text << key << ": {total: " << std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
  for (std::size_t i = first; i < N; ++i) text << ", " << names[i] << ": " << counts[i];
  text << "}\n";
  return text.str();
}

std::string perStream(const char* key, const std::array<std::uint64_t, kStreamCount>& counts) {
  return countsLine<kStreamCount>(key, kSensorNames, counts);
}

std::string noises(const std::vector<StreamNoise>& streams) {
  std::string text = "noise: {";
  for (const StreamNoise& noise : streams) {
    text += (text.back() == '{' ? "" : ", ") + noise.stream + format(": {value: %.9g", noise.sigma) +
            ", unit: " + noise.unit + ", source: " + quoted(noise.source) + "}";
  }
  return text + "}\n";
}

} // namespace

std::string stampText(Stamp stamp) {
  const std::lldiv_t parts = std::lldiv(stamp, 1000000000);
  return format("%s%lld.%09lld", stamp < 0 ? "-" : "", std::llabs(parts.quot), std::llabs(parts.rem));
}

void RunWriter::makeDirectory(const std::string& directory) {
  std::error_code error;
  fs::create_directories(directory, error);
  if (error || !fs::is_directory(directory)) {
    throw std::runtime_error(
        directory + ": cannot be created: " + (error ? error.message() : "it exists and is not a directory"));
  }
}

void RunWriter::requireDirectory(const std::string& directory) {
  fs::path made; // the topmost
  for (fs::path path = fs::absolute(directory); !fs::exists(path); path = path.parent_path()) made = path;
  makeDirectory(directory);
  const int error = access(directory.c_str(), W_OK | X_OK) == 0 ? 0 : errno;
  std::error_code kept;
  if (!made.empty()) fs::remove_all(made, kept);
  if (error != 0) throw std::runtime_error(directory + ": cannot be written: " + std::strerror(error));
}

void RunWriter::addFrame(const Output& output) {
  Run& run = runs_.back();
  if (!run.has_frames) run.records = RunRecords(spool_);
  run.has_frames = true;
  run.records.add(toRecord(output));
}

void RunWriter::addGyro(const Output& output) {
  Run& run = runs_.back();
  if (!run.has_frames) run.records.add(toRecord(output));
}

void RunWriter::restart(std::optional<PathEstimate> path) {
  if (empty()) return;
  try {
    runs_.back().records.close();
  } catch (const std::runtime_error&) {
    // They stay in memory, and the next addFrame says why.
  }
  runs_.back().path = std::move(path);
  runs_.push_back({RunRecords(spool_)});
}

std::string RunWriter::earlierPath(const std::string& directory, std::size_t number) {
  return (fs::path(directory) / (kBeforeReset + std::to_string(number))).string();
}

std::vector<std::size_t> RunWriter::earlierSizes() const {
  std::vector<std::size_t> sizes;
  for (std::size_t i = 0; i + 1 < runs_.size(); ++i) sizes.push_back(runs_[i].records.size());
  return sizes;
}

std::string RunWriter::calibrationText(RigEstimate estimate) const {
  estimate.recording = recording();
  return rigCalibrationText(estimate);
}

void RunWriter::writeRun(const std::string& directory, const Run& run) {
  makeDirectory(directory);
  AtomicFile trajectory(pathIn(directory, kTrajectory));
  AtomicFile dead_reckoning(pathIn(directory, kDeadReckoning));
  AtomicFile covariance(pathIn(directory, kCovariance));
  AtomicFile frames(pathIn(directory, kFrames));
  covariance << kCovarianceHeader;
  frames << "stamp,features,invalid,used,rejected,initialised,removed,landmarks,frame_rejected,nis,nis_dof,"
            "update_ms\n";
  run.records.forEach([&](const RunRecord& r) {
    trajectory << tumLine(r.stamp, toPose(r.world_T_imu));
    dead_reckoning << tumLine(r.stamp, toPose(r.odom_T_imu));
    const Eigen::Map<const Matrix6d> P(r.pose_covariance.data());
    covariance << stampText(r.stamp) + upperTriangle(P) + "\n";
    if (run.has_frames) frames << frameLine(r.report, r.update_s);
  });
  for (AtomicFile* file : {&trajectory, &dead_reckoning, &covariance, &frames}) file->commit();
}

void RunWriter::writeSmoothed(const std::string& directory, const PathEstimate& path) const {
  writeSmoothed(directory, runs_.back().records, path);
}

void RunWriter::writeSmoothed(const std::string& directory, const RunRecords& records,
                              const PathEstimate& path) {
  makeDirectory(directory);
  AtomicFile trajectory(pathIn(directory, kSmoothed));
  AtomicFile covariance(pathIn(directory, kSmoothedCovariance));
  covariance << kCovarianceHeader;
  records.forEach([&](const RunRecord& r) {
    const PathEstimate::Pose now =
        path.at(r.stamp, toPose(r.world_T_imu), Eigen::Map<const Matrix6d>(r.pose_covariance.data()));
    trajectory << tumLine(r.stamp, now.world_T_imu);
    covariance << stampText(r.stamp) + upperTriangle(now.covariance) + "\n";
  });
  for (AtomicFile* file : {&trajectory, &covariance}) file->commit();
}

void RunWriter::writeTrajectory(const std::string& directory) const {
  writeRun(directory, runs_.back());
  for (std::size_t i = 0; i + 1 < runs_.size(); ++i) {
    const std::string earlier = earlierPath(directory, i + 1);
    writeRun(earlier, runs_[i]);
    if (runs_[i].path) writeSmoothed(earlier, runs_[i].records, *runs_[i].path);
  }
}

void RunWriter::writeMap(const std::string& directory, const std::vector<LandmarkEstimate>& landmarks) {
  makeDirectory(directory);
  std::string text = "id,x,y,z,xx,xy,xz,yy,yz,zz\n";
  for (const LandmarkEstimate& landmark : landmarks) {
    const Eigen::Vector3d& p = landmark.position;
    text += format("%llu,%.9f,%.9f,%.9f", static_cast<unsigned long long>(landmark.id), p.x(), p.y(), p.z()) +
            upperTriangle(landmark.covariance) + "\n";
  }
  writeFile(pathIn(directory, kLandmarks), text);
}

RunSummary::RunSummary(const SlamSystem& system)
    : counts(system.counts()),
      noise(system.checks().noise.streams()),
      motion(system.motionText()),
      not_started(system.estimator().startProblem()),
      imu(system.checks().imu.counts()),
      rig(system.estimator().rig()) {}

void RunWriter::write(const std::string& directory, const RunSummary& summary, const MapEstimate& map) const {
  writeTrajectory(directory);
  writeSmoothed(directory, map.path);
  writeMap(directory, map.landmarks);
  writeSummary(directory, summary, map.landmarks.size());
}

void RunWriter::writeSummary(const std::string& directory, const RunSummary& summary,
                             std::size_t landmarks) const {
  makeDirectory(directory);
  const SystemCounts& c = summary.counts;
  const double sensor_s = sensorSeconds();
  std::ostringstream text;
  text << "input: " << quoted(summary.input) << "\nconfig: " << quoted(summary.config)
       << "\nmotion: " << quoted(summary.motion) << "\nnot_started: " << quoted(summary.not_started)
       << "\nbody: " << quoted(summary.body)
       << "\nposes_of: " << (hasFrames() ? "stereo frames" : "gyro samples") << "\nposes: " << size()
       << "\nposes_before_resets: " << list(earlierSizes()) << "\nframes: " << (hasFrames() ? size() : 0)
       << "\nlandmarks: " << landmarks
       << format("\nwall_s: %.3f\nsensor_s: %.3f\ntimes_real_time: %.2f\n", summary.wall_s, sensor_s,
                 summary.wall_s > 0.0 ? sensor_s / summary.wall_s : 0.0)
       << "features: " << c.features << "\nfeatures_invalid: " << c.features_invalid
       << "\nfeatures_used: " << c.features_used << "\nfeatures_rejected: " << c.features_rejected
       << "\nvelocities_contradicting: " << c.velocities_contradicting
       << "\nframes_rejected: " << c.frames_rejected << "\nframes_without_rig: " << c.frames_without_rig
       << "\nframes_before_start: " << c.frames_before_start
       << "\nlandmarks_revisited: " << c.landmarks_revisited << "\nplaces_recognised: " << c.places_recognised
       << "\nrelocalisations: " << c.relocalisations << format("\nblind_s: %.3f", c.blind_s)
       << "\nblind_periods: " << c.blind_periods << "\n"
       << countsLine("divergences", kDivergenceNames, c.divergences, 1) << "resets: " << c.resets
       << "\ngaps: " << c.gaps << "\n"
       << perStream("processed", c.processed) << perStream("late", c.late)
       << perStream("duplicate", c.duplicate) << perStream("stamp_ahead", c.ahead)
       << perStream("stamp_behind", c.behind) << perStream("invalid", c.invalid)
       << "imu: {stutters: " << summary.imu.stutters << ", backwards: " << summary.imu.backwards
       << ", stops: " << summary.imu.stops << "}\nturned_away: {";
  const char* separator = "";
  for (const auto& [reason, count] : summary.turned_away) {
    text << separator << quoted(reason) << ": " << count;
    separator = ", ";
  }
  text << "}\n" << noises(summary.noise);
  if (summary.rig && summary.rig->isEstimated()) {
    const std::string calibration = calibrationText(*summary.rig);
    writeFile(pathIn(directory, kCalibration), calibration);
    text << "calibration:\n";
    std::istringstream lines(calibration);
    for (std::string line; std::getline(lines, line);) {
      if (line.front() != '#') text << "  " << line << "\n";
    }
  }
  writeFile(pathIn(directory, kSummary), text.str());
}

} // namespace vi_ekf_slam
