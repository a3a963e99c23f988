#include "vi_ekf_slam/ros/front_end/front_end_diagnostics.hpp"

#include <algorithm>

namespace vi_ekf_slam {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kSilence = 2.0;    // s of wall time
constexpr double kFewTracks = 0.25; // of those that are wanted

} // namespace

FrontEndDiagnostics::FrontEndDiagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                         const ImageIntake& intake)
    : intake_(intake), updater_(nh, private_nh) {
  updater_.add("images", this, &FrontEndDiagnostics::images);
  updater_.add("tracks", this, &FrontEndDiagnostics::tracks);
  updater_.add("dropped", this, &FrontEndDiagnostics::dropped);
}

void FrontEndDiagnostics::notePair(Stamp stamp) {
  rate_.add(stamp);
  slowest_s_ = std::max(slowest_s_, intake_.lastSeconds());
}

void FrontEndDiagnostics::images(Status& status) {
  const auto silence = rate_.silence();
  if (const std::string problem = intake_.problem(); !problem.empty()) {
    status.summary(DiagnosticStatus::WARN, problem);
  } else if (!silence) {
    status.summary(DiagnosticStatus::WARN, "no pair of images yet");
  } else if (*silence > kSilence) {
    status.summaryf(DiagnosticStatus::WARN, "no pair of images for %.1f s", *silence);
  } else if (const std::string& fault = intake_.lastProblem(); !intake_.lastWasUsed()) {
    status.summary(DiagnosticStatus::WARN, fault);
  } else if (!fault.empty()) {
    status.summary(rowsDiffer(intake_.frontEnd()->report()) ? DiagnosticStatus::WARN : DiagnosticStatus::OK,
                   "used, " + fault);
  } else {
    status.summary(DiagnosticStatus::OK, "good");
  }
  status.add("pairs", intake_.pairs());
  status.addf("rate (Hz)", "%.1f", rate_.rate());
  if (const FrontEnd* front_end = intake_.frontEnd()) {
    const auto say = [](const CameraModel& model) {
      return model.imagesAreRectified() ? "rectified" : "raw";
    };
    status.add("left images", say(front_end->calibration().left));
    status.add("right images", say(front_end->calibration().right));
    status.addf("exposure (mean brightness, 0 to 255)", "%.0f", front_end->report().brightness);
  }
}

void FrontEndDiagnostics::tracks(Status& status) {
  const FrontEnd* front_end = intake_.frontEnd();
  if (front_end == nullptr || intake_.pairs() == 0) {
    status.summary(DiagnosticStatus::WARN, "none yet");
    return;
  }
  const FrontEndReport& report = front_end->report();
  const double wanted = static_cast<double>(intake_.wantedFeatures());
  const bool is_few = static_cast<double>(report.matched) < kFewTracks * wanted;
  status.summaryf(is_few ? DiagnosticStatus::WARN : DiagnosticStatus::OK, "%zu features of %zu tracks",
                  report.matched, front_end->tracks().size());
  status.add("tracks", front_end->tracks().size());
  status.add("stereo matches", report.matched);
  status.addf("mean life (s)", "%.2f", report.mean_life_s);
  status.add("new", report.begun);
  status.add("lost", report.lost);
  status.add("rejected (moves against the others)", report.rejected);
  status.add("predicted by the gyro", report.rotation_known);
  status.addf("frame time (ms of CPU)", "%.2f", 1e3 * intake_.lastSeconds());
  status.addf("slowest frame (ms of CPU)", "%.2f", 1e3 * slowest_s_);
  slowest_s_ = 0.0;
}

void FrontEndDiagnostics::dropped(Status& status) {
  std::uint64_t total = 0;
  for (const auto& [reason, count] : intake_.turnedAway()) {
    status.add(reason, count);
    total += count;
  }
  for (const auto& [reason, count] : intake_.flawed()) status.add(reason, count);
  if (total > reported_) {
    status.summary(DiagnosticStatus::WARN, "images were of no use, or came too fast");
  } else {
    status.summary(DiagnosticStatus::OK, total == 0 ? "none" : "none since the last report");
  }
  reported_ = total;
}

} // namespace vi_ekf_slam
