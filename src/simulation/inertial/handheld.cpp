#include "vi_ekf_slam/simulation/inertial/handheld.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kFullTurn = 6.283185307179586;
constexpr double kSampling = 0.01;  // s, at which limits are looked at: the fastest wave takes 0.5 s
constexpr double kMargin = 0.99;    // of a limit, for what may lie between
constexpr double kSlowShare = 0.5;  // of a limit, which the slow part leaves to the rest
constexpr double kBurstFloor = 0.2; // of the shaking, between two bursts
constexpr int kBisections = 40;

/// Times of one period.
std::vector<double> period() {
  std::vector<double> times;
  for (int i = 0; i * kSampling < Waves::kPeriod; ++i) times.push_back(i * kSampling);
  return times;
}

/// The largest factor whose peak is within `limit`; that of 0 is.
double largestFactor(const std::function<double(double)>& peak, double limit) {
  double low = 0.0, high = 1.0;
  while (peak(high) <= limit && high < 1e6) high *= 2.0;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = 0.5 * (low + high);
    (peak(middle) <= limit ? low : high) = middle;
  }
  return low;
}

double rateNorm(const PoseCoordinates& value, const PoseCoordinates& rate) {
  const Eigen::Vector3d d = rate.tail<3>();
  return std::sqrt(std::max(0.0, d.squaredNorm() - 2.0 * d[0] * d[2] * std::sin(value[4])));
}

} // namespace

void Waves::add(Eigen::Index coordinate, const Band& band, Random& random) {
  for (int i = 0; i < band.count; ++i) {
    const int turns = random.integer(static_cast<int>(std::lround(band.slowest * kPeriod)),
                                     static_cast<int>(std::lround(band.fastest * kPeriod)));
    const double omega = kFullTurn * turns / kPeriod;
    const double amplitude = random.uniform(band.low, band.high) / std::pow(omega, band.order);
    waves_.push_back({coordinate, amplitude, omega, random.uniform(0.0, kFullTurn)});
  }
}

void Waves::scale(double factor) {
  for (Wave& wave : waves_) wave.amplitude *= factor;
}

CoordinateMotion Waves::at(double t) const {
  CoordinateMotion sum{PoseCoordinates::Zero(), PoseCoordinates::Zero(), PoseCoordinates::Zero()};
  for (const Wave& wave : waves_) {
    const double angle = wave.omega * t + wave.phase;
    const double x = wave.amplitude * std::sin(angle), y = wave.amplitude * std::cos(angle);
    sum.value[wave.coordinate] += x;
    sum.rate[wave.coordinate] += wave.omega * y;
    sum.acceleration[wave.coordinate] -= wave.omega * wave.omega * x;
  }
  return sum;
}

HandheldTrajectory::HandheldTrajectory(const DriveOptions& options) : rest_(options.standing_start) {
  Random random(options.seed, RandomStream::kMotion);
  for (const Eigen::Index i : {0, 1}) slow_position_.add(i, {3, 0.025, 0.1, 0.3, 0.6, 0}, random); // m
  slow_position_.add(2, {2, 0.025, 0.1, 0.1, 0.2, 0}, random);
  slow_angles_.add(3, {3, 0.017, 0.067, 0.4, 0.9, 0}, random); // rad
  for (const Eigen::Index i : {4, 5}) slow_angles_.add(i, {2, 0.025, 0.2, 0.03, 0.12, 0}, random);
  // The limits decide about the size of these.
  for (const Eigen::Index i : {0, 1, 2}) fast_position_.add(i, {4, 0.5, 1.8, 0.5, 1.0, 2}, random);
  for (const Eigen::Index i : {3, 4, 5}) fast_angles_.add(i, {4, 0.25, 1.25, 0.5, 1.0, 1}, random);
  for (Burst* burst : {&position_burst_, &angle_burst_})
    *burst = {kFullTurn * random.integer(2, 5) / Waves::kPeriod, random.uniform(0.0, kFullTurn)};
  limitAcceleration(kMargin * options.peak_acceleration);
  limitRate(kMargin * options.peak_rate);
  for (const double t : period()) extent_.extend(unwarped(t).value.head<3>());
  if (rest_ > 0.0) leaveSmoothly(options.peak_acceleration);
}

/// The fast part, in bursts.
CoordinateMotion HandheldTrajectory::shaken(double t) const {
  CoordinateMotion sum{PoseCoordinates::Zero(), PoseCoordinates::Zero(), PoseCoordinates::Zero()};
  for (const auto& [waves, burst] :
       {std::make_pair(&fast_position_, position_burst_), std::make_pair(&fast_angles_, angle_burst_)}) {
    const CoordinateMotion wave = waves->at(t);
    const double angle = burst.omega * t + burst.phase;
    const double b = 0.5 * (1.0 + std::cos(angle)), db = -0.5 * burst.omega * std::sin(angle),
                 ddb = -0.5 * burst.omega * burst.omega * std::cos(angle);
    const double e = kBurstFloor + (1.0 - kBurstFloor) * b * b * b,
                 de = (1.0 - kBurstFloor) * 3.0 * b * b * db,
                 dde = (1.0 - kBurstFloor) * (6.0 * b * db * db + 3.0 * b * b * ddb);
    sum.value += e * wave.value;
    sum.rate += e * wave.rate + de * wave.value;
    sum.acceleration += e * wave.acceleration + 2.0 * de * wave.rate + dde * wave.value;
  }
  return sum;
}

/// Without a standing start.
CoordinateMotion HandheldTrajectory::unwarped(double t) const {
  CoordinateMotion sum = shaken(t);
  for (const Waves* waves : {&slow_position_, &slow_angles_}) {
    const CoordinateMotion slow = waves->at(t);
    sum.value += slow.value;
    sum.rate += slow.rate;
    sum.acceleration += slow.acceleration;
  }
  return sum;
}

void HandheldTrajectory::limitAcceleration(double limit) {
  std::vector<Eigen::Vector3d> slow, fast;
  double slow_peak = 0.0;
  for (const double t : period()) {
    slow.push_back(slow_position_.at(t).acceleration.head<3>());
    fast.push_back(shaken(t).acceleration.head<3>());
    slow_peak = std::max(slow_peak, slow.back().norm());
  }
  const double less = std::min(1.0, kSlowShare * limit / slow_peak);
  slow_position_.scale(less);
  fast_position_.scale(largestFactor(
      [&](double factor) {
        double peak = 0.0;
        for (std::size_t i = 0; i < slow.size(); ++i)
          peak = std::max(peak, (less * slow[i] + factor * fast[i]).norm());
        return peak;
      },
      limit));
}

void HandheldTrajectory::limitRate(double limit) {
  std::vector<CoordinateMotion> slow, fast;
  for (const double t : period()) {
    slow.push_back(slow_angles_.at(t));
    fast.push_back(shaken(t));
  }
  const auto peak = [&](double slow_factor, double fast_factor) {
    double most = 0.0;
    for (std::size_t i = 0; i < slow.size(); ++i)
      most = std::max(most, rateNorm(slow_factor * slow[i].value + fast_factor * fast[i].value,
                                     slow_factor * slow[i].rate + fast_factor * fast[i].rate));
    return most;
  };
  const double less =
      std::min(1.0, largestFactor([&](double factor) { return peak(factor, 0.0); }, kSlowShare * limit));
  slow_angles_.scale(less);
  fast_angles_.scale(largestFactor([&](double factor) { return peak(less, factor); }, limit));
}

/// Takes as long as the limit asks for: the warp of the time accelerates, too.
void HandheldTrajectory::leaveSmoothly(double limit) {
  const auto peak = [this] {
    double most = 0.0;
    for (double t = rest_; t < rest_ + leaving_; t += kSampling)
      most = std::max(most, at(t).acceleration.norm());
    return most;
  };
  for (leaving_ = 2.0; peak() > kMargin * limit;) leaving_ *= 1.5;
}

Kinematics HandheldTrajectory::at(double t) const {
  if (rest_ <= 0.0) return kinematicsOf(unwarped(t));
  // Time goes from rest to full speed by a polynomial with three continuous derivatives.
  double warped = 0.0, rate = 0.0, acceleration = 0.0;
  const double since = t - rest_, x = since / leaving_;
  if (x >= 1.0) {
    warped = since - 0.5 * leaving_;
    rate = 1.0;
  } else if (x > 0.0) {
    const double x3 = x * x * x, x4 = x3 * x;
    warped = leaving_ * x4 * x * (7.0 + x * (-14.0 + x * (10.0 - 2.5 * x)));
    rate = x4 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x)));
    acceleration = x3 * (140.0 + x * (-420.0 + x * (420.0 - 140.0 * x))) / leaving_;
  }
  CoordinateMotion motion = unwarped(warped);
  motion.acceleration = rate * rate * motion.acceleration + acceleration * motion.rate;
  motion.rate *= rate;
  return kinematicsOf(motion);
}

} // namespace vi_ekf_slam::simulation
