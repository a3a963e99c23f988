#include "vi_ekf_slam/core/sensors/arrival_check.hpp"

#include <cmath>
#include <sstream>

namespace vi_ekf_slam {
namespace {

constexpr double kArrivalSpan = 5.0;        // s that are judged: some queue of each stream is empty once
constexpr std::size_t kFewestArrivals = 10; // messages of a stream

} // namespace

std::string ArrivalCheck::note(Stream stream, Stamp stamp, Stamp received) {
  if (judged_) return {};
  if (!begin_) begin_ = received;
  Delay& delay = delays_[static_cast<std::size_t>(stream)];
  const double seconds = secondsBetween(stamp, received);
  if (delay.count++ == 0 || seconds < delay.least) delay.least = seconds;
  if (secondsBetween(*begin_, received) < kArrivalSpan) return {};
  judged_ = true;
  // The one that comes soonest after its stamp is the one that the others are late by.
  std::optional<std::size_t> soonest, latest;
  for (std::size_t i = 0; i < kStreamCount; ++i) {
    if (delays_[i].count < kFewestArrivals) continue;
    if (!soonest || delays_[i].least < delays_[*soonest].least) soonest = i;
    if (!latest || delays_[i].least > delays_[*latest].least) latest = i;
  }
  if (!soonest) return {};
  const double behind = delays_[*latest].least - delays_[*soonest].least;
  if (behind <= limit_) return {};
  std::ostringstream text;
  text.precision(3);
  text << kTopicNames[*latest] << " comes " << behind << " s later after its stamp than "
       << kTopicNames[*soonest] << ", allowed: " << limit_
       << " s (buffer/max_delay_s); one of the two has another clock, or waits somewhere: "
       << "stamps must be the time of measurement in one clock";
  return text.str();
}

} // namespace vi_ekf_slam
