#include "vi_ekf_slam/core/sensors/arrivals.hpp"

#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam {
namespace {

enum class Fault { kNone, kNotFinite, kTooFast, kBadCovariance };

Fault faultOf(const Eigen::Vector3d& value, double max_norm,
              const std::optional<Eigen::Matrix3d>& covariance) {
  if (!value.allFinite()) return Fault::kNotFinite;
  if (!(value.norm() <= max_norm)) return Fault::kTooFast;
  if (!covariance) return Fault::kNone;
  if (!covariance->allFinite()) return Fault::kBadCovariance;
  const Eigen::Matrix3d& C = *covariance;
  const double asymmetry = (C - C.transpose()).cwiseAbs().maxCoeff();
  const bool good = asymmetry <= 1e-9 * C.cwiseAbs().maxCoeff() && isPositiveDefinite(C);
  return good ? Fault::kNone : Fault::kBadCovariance;
}

Fault faultOf(const ImuSample& s) {
  const Fault gyro = faultOf(s.angular_velocity, kMaxAngularSpeed, s.covariance);
  if (gyro != Fault::kNone || !s.acceleration) return gyro;
  return faultOf(*s.acceleration, kMaxAcceleration, s.acceleration_covariance);
}
Fault faultOf(const VelocitySample& s) { return faultOf(s.linear_velocity, kMaxSpeed, s.covariance); }
Fault faultOf(const StereoFrame&) { return Fault::kNone; } // features are judged one by one, by the estimator

} // namespace

bool Arrivals::isValid(const Measurement& measurement) {
  const Fault fault = std::visit([](const auto& sample) { return faultOf(sample); }, measurement);
  if (fault == Fault::kNone) return true;
  const auto stream = static_cast<std::size_t>(streamOf(measurement));
  ++counts_.invalid[stream];
  if (fault == Fault::kTooFast) ++counts_.too_fast[stream];
  if (fault == Fault::kBadCovariance) ++counts_.bad_covariance[stream];
  return false;
}

Arrivals::Verdict Arrivals::add(Measurement measurement) {
  const Verdict verdict = guard_.judge(measurement, buffer_.newest());
  if (verdict == Verdict::kJump) jumped_ = guard_.take();
  if (verdict == Verdict::kPass) buffer(std::move(measurement));
  return verdict;
}

double Arrivals::jump() const { return secondsBetween(*buffer_.newest(), stampOf(jumped_.front())); }

void Arrivals::goOn() {
  for (Measurement& measurement : std::exchange(jumped_, {})) buffer(std::move(measurement));
}

void Arrivals::buffer(Measurement measurement) {
  const auto stream = static_cast<std::size_t>(streamOf(measurement));
  const Stamp stamp = stampOf(measurement);
  using Order = MeasurementBuffer::Verdict;
  const Order order = buffer_.add(std::move(measurement));
  if (order == Order::kDuplicate) ++counts_.duplicate[stream];
  // A jump back is within what confirmed a jump; the guard keeps others away.
  if (order == Order::kLate || order == Order::kJumpBack) ++counts_.late[stream];
  if (order != Order::kJumpBack && !first_stamp_) first_stamp_ = stamp;
}

void Arrivals::clear() {
  buffer_.clear();
  first_stamp_.reset();
}

std::optional<double> Arrivals::duration() const {
  if (!first_stamp_ || !buffer_.newest()) return std::nullopt;
  return secondsBetween(*first_stamp_, *buffer_.newest());
}

ArrivalCounts Arrivals::counts() const {
  ArrivalCounts counts = counts_;
  counts.ahead = guard_.strays().ahead;
  counts.behind = guard_.strays().behind;
  return counts;
}

} // namespace vi_ekf_slam
