#pragma once

#include <diagnostic_updater/diagnostic_updater.h>

#include <algorithm>
#include <map>
#include <string>

#include "vi_ekf_slam/ros/front_end/image_intake.hpp"
#include "vi_ekf_slam/ros/node/diagnostics.hpp"

namespace vi_ekf_slam {

/// What /diagnostics says about the front end.
class FrontEndDiagnostics {
 public:
  /// `intake` must outlive this.
  FrontEndDiagnostics(ros::NodeHandle nh, ros::NodeHandle private_nh, const ImageIntake& intake);

  void notePair(Stamp stamp);
  void publish() { updater_.force_update(); }
  /// s of wall time between reports: ~diagnostic_period, 1 s where it is not set.
  double period() { return std::max(0.05, updater_.getPeriod()); }

 private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void images(Status& status);
  void tracks(Status& status);
  void dropped(Status& status);

  const ImageIntake& intake_;
  RateMeter rate_;
  double slowest_s_ = 0.0; ///< since the last report
  std::uint64_t reported_ = 0;
  diagnostic_updater::Updater updater_;
};

} // namespace vi_ekf_slam
