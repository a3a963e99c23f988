#include "vi_ekf_slam/core/slam/motion_check.hpp"

#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kWindow = 1.0;      // s
constexpr double kFreshSample = 0.5; // s; an older sample says nothing of now
constexpr double kFrameStep = 0.08;  // s between frames that are looked at
// Of the features in each frame of a window that has so many: where cars or a lorry fill the picture they are
// no measure. Fewer are bridged, as far as that is known well enough.
constexpr std::size_t kFew = 10;
constexpr double kUsedShare = 0.7;
// A window counts where the sensor says that it moves by more, so that a bus that passes a car at rest does
// not, and three standard deviations are less than this share of it. No calibration that is about right, no
// wheel's slip and no gyro's scale has the two so far apart.
constexpr double kLeastTurn = 0.1, kLeastWay = 0.3; // rad, m
// Cars that drive along may fill the picture, by which the vehicle hardly moves then: as far as it may be a
// car.
constexpr double kConvoyShare = 0.25, kFastestCar = 60.0; // of what is told, m in 1 s
constexpr double kTurnShare = 0.5, kWayShare = 0.3;
constexpr double kSigmasApart = 3.0;
// Windows of which these shares agree, contradict; what is mixed by then is something else. A fault
// contradicts in each, traffic in one of six on the worst of 14 drives.
constexpr std::size_t kEnough = 6, kEnoughToBlame = 10, kMixed = 30;
constexpr double kAgreeing = 0.8, kContradicting = 0.9;
constexpr double kLongestLook = 40.0; // s that are looked at, of a vehicle that hardly moves or turns
constexpr std::size_t kTracked = 20;  // landmarks, for little time
constexpr double kSameSize = 1.25;    // ratio up to which two motions differ by their direction
constexpr double kDegrees = 57.3;
// s; between the clocks of gyro and pictures, beside half the time between two samples: on a hand-held rig
// 10 ms cost no accuracy, with 20 ms the vertical is 0.15 rad off when it starts. How many standard
// deviations it is then, how well one that is none is known, and the slowest gyro that tells.
constexpr double kLargestOffset = 0.01, kSureOfOffset = 5.0, kOffsetSigma = 0.003, kSlowestGyro = 0.02;
constexpr int kClockWindows = 6;
constexpr double kSlips = 0.5; // s in which each frame has a velocity before it that contradicts

InvariantConfig picturesAlone(InvariantConfig config) {
  config.choice = MotionChoice::kConstantTwist;
  config.map.keep = MapKeep::kNone;
  config.recognise_places = PlaceRecognition::kNone;
  config.max_tracked = kTracked;
  config.standstill_px = 0.0;
  config.slip.sigma = 0.0;
  config.rig.rotation_sigma = config.rig.translation_sigma = Eigen::Vector3d::Zero();
  config.rig.time_offset_sigma = config.rig.scale_sigma = 0.0;
  // Whatever its axes are, since the transform may be a wrong one.
  for (Vector6d* v : {&config.motion.twist_density, &config.motion.prior_twist_sigma}) {
    v->head<3>().setConstant(v->head<3>().maxCoeff());
    v->tail<3>().setConstant(v->tail<3>().maxCoeff());
  }
  return config;
}

bool mayBeConvoy(double seen, double told) { return told < kFastestCar && seen < kConvoyShare * told; }

} // namespace

MotionCheck::MotionCheck(const InvariantConfig& config)
    : config_(picturesAlone(config)), knows_clock_(config.rig.time_offset_sigma > 0.0) {}

void MotionCheck::Samples::add(Stamp stamp, const Eigen::Vector3d& value, double sample_variance) {
  is_stuck = is_stuck && (!last || value == newest);
  newest = value;
  sum += value;
  variances += sample_variance;
  ++count;
  last = stamp;
}

bool MotionCheck::Samples::isFresh(Stamp now) const {
  return last && secondsBetween(*last, now) < kFreshSample;
}

bool MotionCheck::Samples::take(Stamp now) {
  taken = count;
  if (count > 0) {
    const auto n = static_cast<double>(count);
    mean = sum / n;
    variance = variances / (n * n);
    sum.setZero();
    variances = 0.0;
    count = 0;
  }
  return isFresh(now);
}

void MotionCheck::Judged::add(const Compared& motion, double sigma, double offset) {
  if (kSigmasApart * sigma > motion.allowed()) return;
  windows.push_back(motion);
  const auto all = static_cast<double>(windows.size());
  // What is common to all windows is a bias, unless it is larger than one. A sensor of another sign, unit or
  // axes is as far apart as the body moves, each time another way.
  Eigen::Vector3d common = Eigen::Vector3d::Zero();
  for (const Compared& w : windows) common += w.apart / all;
  if (common.norm() > offset) common.setZero();
  contradicting.clear();
  std::size_t agreeing = 0;
  for (const Compared& w : windows) {
    if (w.agrees())
      ++agreeing;
    else if ((w.apart - common).norm() >= w.allowed())
      contradicting.push_back(w);
  }
  is_done = windows.size() >= kMixed || contradicts() ||
            (windows.size() >= kEnough && static_cast<double>(agreeing) >= kAgreeing * all);
}

bool MotionCheck::Judged::contradicts() const {
  return windows.size() >= kEnoughToBlame &&
         static_cast<double>(contradicting.size()) >= kContradicting * static_cast<double>(windows.size());
}

MotionCheck::Compared MotionCheck::Judged::median() const {
  std::vector<Compared> sorted = contradicting;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end(),
                   [](const Compared& a, const Compared& b) { return a.apart.norm() < b.apart.norm(); });
  return *middle;
}

void MotionCheck::note(const ImuSample& sample) {
  bias_sigma_ = sample.acceleration ? std::sqrt(3.0) * config_.inertial.gyro_bias_sigma
                                    : config_.motion.prior_bias_sigma.tail<3>().norm();
  const double sigma = config_.motion.gyro_sigma;
  gyro_.add(sample.stamp, sample.angular_velocity,
            sample.covariance ? sample.covariance->trace() : 3.0 * sigma * sigma);
}

void MotionCheck::note(const VelocitySample& sample) {
  const double sigma = config_.motion.velocity_sigma;
  velocity_.add(sample.stamp, sample.linear_velocity,
                sample.covariance ? sample.covariance->trace() : 3.0 * sigma * sigma);
}

void MotionCheck::restart() {
  window_.reset();
  gyro_ = velocity_ = {};
  contradicts_since_.reset();
}

/// Whether it moves now by what would count; of a sensor that is stuck the other one tells.
bool MotionCheck::hasWork(Stamp now) const {
  if (!config_.told_rig || worked_s_ >= kLongestLook) return false;
  const bool turns = gyro_.isFresh(now) && kWindow * gyro_.newest.norm() > kLeastTurn;
  const bool travels = velocity_.isFresh(now) && kWindow * velocity_.newest.norm() > kLeastWay;
  return (!(turn_.is_done && knows_clock_) && gyro_.isFresh(now) && (turns || (gyro_.is_stuck && travels))) ||
         (!way_.is_done && velocity_.isFresh(now) && (travels || (velocity_.is_stuck && turns)));
}

/// With an odometry of its own, whose covariance is that of the motion since.
void MotionCheck::begin(const StereoFrame& frame) {
  gyro_.take(frame.stamp);
  velocity_.take(frame.stamp);
  window_ = Window();
  window_->begin = window_->last = frame.stamp;
  window_->rate = gyro_.newest;
  window_->odometry = std::make_unique<InvariantEstimator>(config_);
  window_->odometry->process(frame);
  window_->start = window_->odometry->state().world_T_imu;
}

std::string MotionCheck::note(const StereoFrame& frame) {
  if (!window_) {
    if (hasWork(frame.stamp)) begin(frame);
    return {};
  }
  Window& w = *window_;
  const double dt = secondsBetween(w.last, frame.stamp);
  if (dt < kFrameStep) return {};
  worked_s_ += dt;
  const SE3 before = w.start.inverse() * w.odometry->state().world_T_imu;
  const FrameReport report = w.odometry->process(frame);
  const std::size_t seen = report.used + report.rejected;
  const bool is_sound =
      !report.frame_rejected && report.divergence == Divergence::kNone &&
      (seen < kFew || static_cast<double>(report.used) >= kUsedShare * static_cast<double>(seen));
  w.has_gyro = gyro_.take(frame.stamp) && w.has_gyro;
  w.has_velocity = velocity_.take(frame.stamp) && w.has_velocity;
  w.turned = w.turned * so3::Exp(dt * gyro_.mean);
  w.way += dt * (before.rotation() * velocity_.mean);
  w.angle += dt * gyro_.mean.norm();
  w.gyro_samples += gyro_.taken;
  w.turned_variance += dt * dt * gyro_.variance;
  w.way_variance += dt * dt * velocity_.variance;
  w.last = frame.stamp;
  const bool is_whole = is_sound && dt < kFreshSample;
  if (is_whole && secondsBetween(w.begin, w.last) < kWindow) return {};
  std::string said = is_whole ? judge() : std::string();
  window_.reset();
  if (hasWork(frame.stamp)) begin(frame);
  return said;
}

std::string MotionCheck::note(const FrameReport& report) {
  if (report.contradicting_velocities == 0) {
    contradicts_since_.reset();
    return {};
  }
  if (!contradicts_since_) contradicts_since_ = report.stamp;
  if (says_slip_ || secondsBetween(*contradicts_since_, report.stamp) < kSlips) return {};
  says_slip_ = true;
  return "the velocity contradicts the estimate, and counts less while it does; do the wheels slip, are they "
         "blocked, or is the velocity's sigma too small?";
}

std::string MotionCheck::judge() {
  const Window& w = *window_;
  const StateEstimate state = w.odometry->state();
  const SE3 seen = w.start.inverse() * state.world_T_imu;
  const double length = secondsBetween(w.begin, w.last);
  const auto variance = [&state](Eigen::Index row) {
    return state.pose_covariance.block<3, 3>(row, row).trace();
  };
  std::string said;
  const Compared turn{w.angle, so3::Log(w.turned).norm(), so3::Log(seen.rotation()).norm(),
                      so3::Log(w.turned.transpose() * seen.rotation()), kTurnShare};
  const bool turns = w.has_gyro && turn.told > kLeastTurn;
  if (!turn_.is_done && (turns || (w.has_gyro && gyro_.is_stuck && turn.seen > kLeastTurn))) {
    turn_.add(turn, std::sqrt(w.turned_variance + variance(3)), kSigmasApart * length * bias_sigma_);
    addProblem(said, turnProblem());
  }
  if (!knows_clock_ && w.has_gyro && (turn.agrees() || std::max(turn.told, turn.seen) < kLeastTurn))
    addProblem(said, judgeClock(seen.rotation(), std::sqrt((w.turned_variance + variance(3)) / 3.0)));
  const Compared way{w.way.norm(), w.way.norm(), seen.translation().norm(), w.way - seen.translation(),
                     kWayShare};
  const bool travels = way.told > kLeastWay && !mayBeConvoy(way.seen, way.told);
  // At rest a bus may pass. What turns as the pictures do is not at rest.
  const bool is_stuck =
      velocity_.is_stuck && way.seen > kLeastWay && turns && turn.apart.norm() < kTurnShare * turn.told;
  if (!way_.is_done && w.has_velocity && (travels || is_stuck)) {
    way_.add(way, std::sqrt(w.way_variance + variance(0)), 0.0);
    addProblem(said, wayProblem());
  }
  addProblem(problem_, said);
  return said;
}

/// `sigma` rad, of the turn on each axis.
std::string MotionCheck::judgeClock(const Eigen::Matrix3d& seen, double sigma) {
  const Window& w = *window_;
  const double period = secondsBetween(w.begin, w.last) / static_cast<double>(w.gyro_samples);
  if (!(period <= kSlowestGyro)) return {};
  clock_.add(gyro_.newest - w.turned.transpose() * w.rate, so3::Log(w.turned.transpose() * seen), sigma);
  const auto offset = clock_.estimate();
  if (!offset || clock_.count() < kClockWindows) return {};
  const double allowed = kLargestOffset + 0.5 * period;
  const bool is_off = std::abs(offset->tau) > std::max(allowed, kSureOfOffset * offset->sigma);
  knows_clock_ = is_off || offset->sigma <= kOffsetSigma;
  if (!is_off) return {};
  return "the pictures' stamps are " + rounded(offset->tau) + " s (sigma " + rounded(offset->sigma) +
         ") off the gyro's clock, allowed: " + rounded(allowed) +
         "; set calibration/time_offset: " + rounded(config_.rig.time_offset + offset->tau) +
         ", or calibration/time_offset_sigma: 0.01, with which it is estimated";
}

std::string MotionCheck::turnProblem() const {
  if (!turn_.contradicts()) return {};
  const Compared m = turn_.median();
  std::string hint = "are the gyro's axes those of the transform to the camera, and is that not inverted?";
  if (gyro_.is_stuck) hint = "is it connected? all its samples are the same";
  if (m.whole > kDegrees / 3.0 * m.seen) hint = "is the gyro in deg/s? it must be in rad/s";
  return "the gyro does not turn" + asThePicturesDo(turn_, " rad", hint);
}

std::string MotionCheck::wayProblem() const {
  if (!way_.contradicts()) return {};
  const Compared m = way_.median();
  const double ratio = std::max(m.told, m.seen) / std::max(1e-9, std::min(m.told, m.seen));
  std::string hint =
      "is the velocity backwards, or along other axes than its frame_id says, or the transform to the "
      "camera inverted?";
  if (ratio > kSameSize) hint = "is the velocity in m/s, and the baseline of camera_info the right one?";
  if (velocity_.is_stuck) hint = "is its sensor connected? all its samples are the same";
  return "the velocity does not move" + asThePicturesDo(way_, " m", hint);
}

/// The rest of what is said.
std::string MotionCheck::asThePicturesDo(const Judged& judged, const std::string& unit,
                                         const std::string& hint) {
  const Compared m = judged.median();
  return " as the pictures do: in 1 s by " + rounded(m.whole) + unit + ", the pictures by " +
         rounded(m.seen) + ", " + rounded(m.apart.norm()) + unit +
         " apart, allowed: " + rounded(m.allowed()) + " (median of " +
         std::to_string(judged.contradicting.size()) + "); " + hint + " (check_rig.py tells more)";
}

} // namespace vi_ekf_slam
