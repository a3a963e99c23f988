#include "vi_ekf_slam/core/sensors/arrival_check.hpp"

#include <utility>

#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kArrivalSpan = 5.0;        // s that are judged: some queue of each stream is empty once
constexpr std::size_t kFewestArrivals = 10; // messages of a stream
constexpr double kJumpBack = 1.0;           // s between two stamps of a stream: a bag that loops

} // namespace

std::string ArrivalCheck::note(Stream stream, Stamp stamp, Stamp received) {
  if (told_) return {};
  const auto index = static_cast<std::size_t>(stream);
  const std::optional<Stamp> before = std::exchange(stamps_[index], stamp);
  const bool goes_back = before && secondsBetween(stamp, *before) > kJumpBack;
  if (!begin_ || received < *begin_ || goes_back) {
    begin_ = received;
    delays_.fill({});
  }
  Delay& delay = delays_[index];
  const double seconds = secondsBetween(stamp, received);
  if (delay.count++ == 0 || seconds < delay.least) delay.least = seconds;
  if (secondsBetween(*begin_, received) < kArrivalSpan) return {};
  const std::array<Delay, kStreamCount> delays = std::exchange(delays_, {});
  begin_ = received;
  // The one that comes soonest after its stamp is the one that the others are late by.
  std::optional<std::size_t> soonest, latest;
  for (std::size_t i = 0; i < kStreamCount; ++i) {
    if (delays[i].count < kFewestArrivals) continue;
    if (!soonest || delays[i].least < delays[*soonest].least) soonest = i;
    if (!latest || delays[i].least > delays[*latest].least) latest = i;
  }
  const double behind = soonest ? delays[*latest].least - delays[*soonest].least : 0.0;
  suspected_ = behind > limit_ ? suspected_ + 1 : 0;
  if (suspected_ < 2) return {};
  told_ = true;
  return std::string(kTopicNames[*latest]) + " comes " + rounded(behind) + " s later after its stamp than " +
         kTopicNames[*soonest] + ", allowed: " + rounded(limit_) +
         " s (buffer/max_delay_s); one of the two has another clock, or waits somewhere: "
         "stamps must be the time of measurement in one clock";
}

} // namespace vi_ekf_slam
