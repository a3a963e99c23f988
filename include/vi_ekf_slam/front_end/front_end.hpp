#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/front_end/corner_detector.hpp"
#include "vi_ekf_slam/front_end/motion_predictor.hpp"
#include "vi_ekf_slam/front_end/picture.hpp"
#include "vi_ekf_slam/front_end/stereo_calibration.hpp"
#include "vi_ekf_slam/front_end/stereo_matcher.hpp"
#include "vi_ekf_slam/front_end/track.hpp"

namespace vi_ekf_slam {

/// One exposure of the pair: 8 bit, one channel, of the calibration's size. They need not outlive the call.
struct StereoImages {
  Stamp stamp = 0;
  cv::Mat left, right;
};

/// Points that both pictures of a pair show.
struct RowCount {
  std::size_t seen = 0;
  std::size_t off = 0; ///< too far off their row for a match
};

/// What the front end did with one pair.
struct FrontEndReport {
  PictureFault left = PictureFault::kNone, right = PictureFault::kNone;
  bool stamp_refused = false;   ///< not later than the pair before: nothing was done
  bool begun_anew = false;      ///< all tracks ended: the gap was too long, or time jumped back
  bool too_late = false;        ///< more than tracks are bridged after the pair before
  bool is_one_picture = false;  ///< left and right are the same, bit for bit
  bool left_repeated = false;   ///< the picture of the pair before, where the camera is not at rest
  bool right_repeated = false;  ///< the same
  bool sent_twice = false;      ///< it is repeated sooner than a camera can rest: no pair at all
  bool has_stopped = false;     ///< it is repeated although the gyro says that it turns
  bool exchanged = false;       ///< left and right look exchanged
  bool without_matches = false; ///< hardly any point of the left picture is found in the right one
  bool without_texture = false; ///< hardly anything to follow in the left picture (dark, blurred, empty)
  bool rotation_known = false;  ///< the gyro predicted where the tracks went
  std::size_t followed = 0;     ///< tracks that went on
  std::size_t lost = 0;         ///< tracks that ended: not found again
  std::size_t rejected = 0;     ///< tracks that ended: they move against what the others see
  std::size_t begun = 0;        ///< new tracks
  std::size_t matched = 0;      ///< of all tracks, found in the right picture: the features that go out
  double mean_life_s = 0.0;     ///< s, of the tracks that are alive
  double brightness = 0.0;      ///< mean of the left picture, 0 to 255
  RowCount rows; ///< of the last pair at which all tracks began: later only those that match are followed
  std::string failure; ///< what OpenCV failed at: the pair is of no use, and all tracks ended
};

/// What is wrong with the pair, in words; empty: nothing.
std::string problemOf(const FrontEndReport& report);
/// Whether so many points are off their row that camera_info cannot be that of these pictures.
bool rowsDiffer(const FrontEndReport& report);
/// Whether it was used as any other: what is wrong with it, if anything, is a part that is missing, or its
/// calibration.
bool wasUsed(const FrontEndReport& report);

struct FrontEndOptions {
  std::size_t features = 130; ///< tracks that are kept up
};

/// Follows corners through the left images of a stereo pair and finds each in the right one: images in,
/// features with an id for life out. Deterministic: what comes out depends on images, samples and their
/// stamps alone.
class FrontEnd {
 public:
  FrontEnd(const StereoCalibration& calibration, const FrontEndOptions& options);
  FrontEnd(const FrontEnd&) = delete;
  FrontEnd& operator=(const FrontEnd&) = delete;

  /// See MotionPredictor: what is known of the motion says where tracks are looked for.
  void setImuRotation(const Eigen::Matrix3d& cam_R_imu) { motion_.setImuRotation(cam_R_imu); }
  void addImu(const ImuSample& sample) { motion_.addImu(sample); }

  /// The features of the pair, in rectified pixels; empty where a picture is of no use. Pairs come in the
  /// order of their stamps.
  StereoFrame process(const StereoImages& images);

  /// Of the last pair.
  const FrontEndReport& report() const { return report_; }
  const std::vector<Track>& tracks() const { return tracks_; }
  const StereoCalibration& calibration() const { return calibration_; }

 private:
  struct Last {
    Picture left;
    Stamp stamp;
  };

  /// Since the last pair that was of use; 0 before the first.
  double secondsSinceLast(Stamp stamp) const { return last_ ? secondsBetween(last_->stamp, stamp) : 0.0; }
  StereoFrame use(const StereoImages& images);
  bool lookRepeated(const Picture& left, const Picture& right, Stamp before, Stamp now);
  void followLight(const Light& light, Stamp stamp);
  std::vector<TrackPrediction> predict(const SE3& now_T_before) const;
  std::vector<bool> find(const Picture& left, const std::vector<TrackPrediction>& predictions);
  void learnMotion(const MotionPredictor::Prediction& prediction, Stamp stamp);
  void follow(const Picture& left, Stamp stamp);
  void rectify(std::vector<Track>& tracks) const;
  void beginTracks(const Picture& left, Stamp stamp);
  void matchTracks(const Picture& left, const Picture& right);
  void describeTracks(const Picture& left, Stamp stamp);
  StereoFrame features(Stamp stamp, double seconds) const;
  void summarise(Stamp stamp);

  StereoCalibration calibration_;
  FrontEndOptions options_;
  CornerDetector detector_;
  StereoMatcher matcher_;
  MotionPredictor motion_;
  std::optional<Last> last_;
  Light light_;                      ///< of all pictures, once they are prepared
  Stamp newest_stamp_ = 0;           ///< of any pair
  cv::Mat left_shown_, right_shown_; ///< thumbnails of any pair
  Stamp shown_since_ = 0;            ///< of the first pair that showed them
  bool has_stopped_ = false;         ///< one of the cameras or both
  bool exchanged_ = false;
  RowCount rows_;
  /// Counts up from the first pair's stamp in us, so that a map of an earlier start has other ids.
  FeatureId next_id_ = 0;
  std::vector<Track> tracks_;
  FrontEndReport report_;
};

} // namespace vi_ekf_slam
