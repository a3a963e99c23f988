#include <string>

#include "vi_ekf_slam/core/sensors/words.hpp"
#include "vi_ekf_slam/front_end/front_end.hpp"

namespace vi_ekf_slam {
namespace {

// Of drawn pictures 1 % are off at most, of recorded ones 14 %; of lenses that camera_info leaves out 53 %
// and more.
constexpr std::size_t kOfWhichOff = 4; // of so many points
constexpr const char* kOtherRows =
    "more than a quarter of the first points lie in different rows of left and right: "
    "camera_info (D, K, R, P) is not that of these pictures, or they are not of one moment";

bool isRepeated(const FrontEndReport& report) { return report.left_repeated || report.right_repeated; }

bool isDark(const FrontEndReport& report) { return report.brightness < kDark; }

/// Why there is hardly any point, or none that both pictures show. (In the dark corners are of noise.)
std::string scarcityOf(const FrontEndReport& report) {
  const std::string dark = isDark(report) ? "dark, " : "";
  if (report.without_matches && rowsDiffer(report)) return kOtherRows;
  if (report.without_matches)
    return "hardly any point is found in the right picture: " + dark +
           "not of one moment, another calibration, or left and right exchanged";
  if (report.without_texture) return "hardly any texture: " + dark + "blurred, or an empty wall";
  return {};
}

/// Of a picture: the worse one's, else the left one's.
std::string faultOf(const FrontEndReport& report) {
  const bool is_right =
      report.left == PictureFault::kNone || (isUseless(report.right) && !isUseless(report.left));
  const PictureFault fault = is_right ? report.right : report.left;
  if (fault == PictureFault::kNone) return {};
  return std::string(is_right ? "right" : "left") + " picture: " + describe(fault);
}

} // namespace

std::string problemOf(const FrontEndReport& report) {
  if (report.stamp_refused) return "its stamp is not later than that of the pair before";
  if (!report.failure.empty()) return "OpenCV fails: " + report.failure;
  const std::string scarcity = scarcityOf(report), fault = faultOf(report);
  // Of the darkest so few grey levels are left that parts look missing.
  if (!scarcity.empty() && isDark(report) && !report.exchanged) return scarcity;
  if (isUseless(report.left) || isUseless(report.right)) return fault;
  if (report.is_one_picture)
    return "left and right are the same picture, without disparity (one topic for both)";
  if (isRepeated(report)) {
    const char* which = "pictures";
    if (!report.right_repeated) which = "left picture";
    if (!report.left_repeated) which = "right picture";
    return std::string("the same ") + which + " as before, " +
           (report.has_stopped ? "although the gyro turns (a camera that has stopped)"
                               : "less than 0.2 s after the first of them (sent twice)");
  }
  std::string problem;
  if (report.exchanged) {
    problem = "left and right look exchanged";
  } else if (!scarcity.empty()) {
    problem = scarcity;
  } else if (report.too_late) {
    problem =
        "more than 0.5 s after the pair before: all tracks begin anew, as with images at 2 Hz and slower";
  }
  if (rowsDiffer(report) && !report.exchanged && !report.without_matches) addProblem(problem, kOtherRows);
  addProblem(problem, fault);
  return problem;
}

bool rowsDiffer(const FrontEndReport& report) { return kOfWhichOff * report.rows.off > report.rows.seen; }

bool wasUsed(const FrontEndReport& report) {
  return !(report.stamp_refused || isUseless(report.left) || isUseless(report.right) ||
           report.is_one_picture || isRepeated(report) || report.exchanged || report.without_matches ||
           report.without_texture || report.too_late || !report.failure.empty());
}

} // namespace vi_ekf_slam
