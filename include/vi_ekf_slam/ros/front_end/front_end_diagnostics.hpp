#pragma once

#include "vi_ekf_slam/ros/front_end/image_intake.hpp"
#include "vi_ekf_slam/ros/node/diagnostics.hpp"

namespace vi_ekf_slam {

/// What /diagnostics says about the front end.
class FrontEndDiagnostics {
 public:
  /// `intake` must outlive this.
  FrontEndDiagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                      const ImageIntake& intake);

  void notePair(Stamp stamp);
  void reportIfDue() { updater_.reportIfDue(); }

 private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void images(Status& status);
  void tracks(Status& status);
  void dropped(Status& status);

  const ImageIntake& intake_;
  RateMeter rate_;
  double slowest_s_ = 0.0; ///< since the last report
  std::uint64_t reported_ = 0;
  DiagnosticUpdater updater_;
};

} // namespace vi_ekf_slam
