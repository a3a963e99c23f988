#include "vi_ekf_slam/front_end/front_end.hpp"

#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/front_end/descriptors.hpp"
#include "vi_ekf_slam/front_end/ego_motion.hpp"
#include "vi_ekf_slam/front_end/flow.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kMaxGap = 0.5;           // s over which tracks are bridged
constexpr double kJump = 1.0;             // s back: time begins anew
constexpr float kMaxFlowRoundTrip = 0.5f; // px
constexpr double kMisfit = 1.0;           // px from where a point of the static world would be
constexpr int kMaxUnmatched = 5;          // pairs
constexpr double kLightTime = 2.0;        // s; exposure controls are faster, the light of a scene slower
// s for which a descriptor is good: to describe every track in every pair takes as long as to follow half of
// them.
constexpr double kDescribed = 0.2;
constexpr std::size_t kFewestToJudge = 10; // points whose matches, or lack of them, say something of a pair
constexpr std::size_t kOfWhichMatch = 10;  // of so many points one matches at least in a pair that is one
constexpr std::size_t kLittleTexture = 10; // tracks
constexpr std::size_t kFewestForRows = 50; // points that tell whether rows agree
// rad/s that a gyro may show at rest, three of the sigmas that the filter takes its bias to have: a camera
// that is simulated without noise repeats its picture rightly then.
constexpr double kMostGyroBias = 0.3;
// s; what repeats for less is no rest, but a picture that was sent twice.
constexpr double kLeastRest = 0.2;
constexpr double kTurned = 1.0; // px, of which a picture shows that the camera has turned
// px, RMS over the lives of tracks on recorded drives: a patch hides the shape of what it shows, and that
// error stays much the same from image to image. A filter that takes the errors of two images as independent
// is to be told of all of it (docs/front_end.md).
constexpr double kLifeSigma = 0.8;
// px, what is added of image to image before a track has shown its own, and how many residuals that is worth.
constexpr double kPriorSigma = 0.25, kPriorWeight = 5.0, kMaxWeight = 20.0;

constexpr float kPredictionReach = AnchorPatch::kHalf; // px
constexpr float kFlowReach = 1.5f;                     // px

template <typename Predicate>
std::size_t removeTracks(std::vector<Track>& tracks, const Predicate& is_over) {
  const std::size_t before = tracks.size();
  tracks.erase(std::remove_if(tracks.begin(), tracks.end(), is_over), tracks.end());
  return before - tracks.size();
}

bool isSame(const cv::Mat& a, const cv::Mat& b) {
  return !a.empty() && a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0.0;
}

} // namespace

FrontEnd::FrontEnd(const StereoCalibration& calibration, const FrontEndOptions& options)
    : calibration_(calibration),
      options_(options),
      detector_(calibration.left.size(), options.features),
      matcher_(calibration_) {}

StereoFrame FrontEnd::process(const StereoImages& images) {
  try {
    return use(images);
  } catch (const cv::Exception& e) { // half done: some tracks are of this pair, others of the one before
    report_.failure = e.err;
    tracks_.clear();
    last_.reset();
    return {images.stamp, {}};
  }
}

StereoFrame FrontEnd::use(const StereoImages& images) {
  report_ = {};
  const bool has_jumped = secondsBetween(images.stamp, newest_stamp_) > kJump;
  if (images.stamp <= newest_stamp_ && !has_jumped) {
    report_.stamp_refused = true;
    return {images.stamp, {}};
  }
  constexpr Stamp kMicrosecond = 1000; // ns
  if (next_id_ == 0) next_id_ = 1 + static_cast<FeatureId>(std::max<Stamp>(images.stamp, 0) / kMicrosecond);
  // What a filter takes as the time between them: it hears of pairs that are of no use, too.
  const Stamp before = newest_stamp_;
  const double seconds = secondsBetween(before, images.stamp);
  newest_stamp_ = images.stamp;
  Picture left = judgePicture(images.left, calibration_.left.size());
  Picture right = judgePicture(images.right, calibration_.right.size());
  report_.left = left.fault;
  report_.right = right.fault;
  report_.brightness = left.light.mean;
  report_.is_one_picture = isSame(left.thumbnail, right.thumbnail) && isSame(images.left, images.right);
  const bool is_repeated = lookRepeated(left, right, before, images.stamp);
  if (report_.sent_twice) { // as if it had not come: to hear of a pair without tracks would end all of them
    newest_stamp_ = before;
    return {images.stamp, {}};
  }
  for (Track& track : tracks_) {
    if (track.matched) track.strayed = 0.0; // it has been told
    track.matched = false;
  }
  if (!tracks_.empty() && (has_jumped || secondsSinceLast(images.stamp) > kMaxGap)) {
    tracks_.clear();
    report_.begun_anew = true;
  }
  report_.too_late = last_ && seconds > kMaxGap;
  if (has_jumped) last_.reset();
  if (isUseless(left.fault) || isUseless(right.fault) || report_.is_one_picture || is_repeated)
    return {images.stamp, {}};
  followLight(left.light, images.stamp);
  preparePicture(left, light_);
  preparePicture(right, light_);
  follow(left, images.stamp);
  beginTracks(left, images.stamp);
  matchTracks(left, right);
  last_ = Last{left, images.stamp};
  last_->left.image.release(); // the pyramid has it
  motion_.forgetBefore(images.stamp);
  summarise(images.stamp);
  describeTracks(left, images.stamp);
  return features(images.stamp, seconds);
}

/// Whether one of them shows what that of the pair before shows although the gyro has turned, or had while
/// it did, or too soon for a camera that has come to rest.
bool FrontEnd::lookRepeated(const Picture& left, const Picture& right, Stamp before, Stamp now) {
  const bool left_same = isSame(left.thumbnail, left_shown_);
  const bool right_same = isSame(right.thumbnail, right_shown_);
  left_shown_ = left.thumbnail;
  right_shown_ = right.thumbnail;
  const bool is_new = !left_same && !right_same;
  if (is_new || now < shown_since_) shown_since_ = now;
  if (is_new) return has_stopped_ = false;
  const auto [motion, rotation_known] = motion_.predict(before, now);
  const double angle = so3::Log(motion.rotation()).norm() - kMostGyroBias * secondsBetween(before, now);
  has_stopped_ = has_stopped_ || (rotation_known && calibration_.camera.fu * angle > kTurned);
  report_.sent_twice = secondsBetween(shown_since_, now) < kLeastRest;
  const bool is_repeated = has_stopped_ || report_.sent_twice;
  report_.left_repeated = is_repeated && left_same;
  report_.right_repeated = is_repeated && right_same;
  report_.has_stopped = has_stopped_;
  return is_repeated;
}

/// Slowly, so that pictures are alike from one to the next, and yet hardly changed.
void FrontEnd::followLight(const Light& light, Stamp stamp) {
  const double share = last_ ? std::min(1.0, secondsSinceLast(stamp) / kLightTime) : 1.0;
  light_.mean += share * (light.mean - light_.mean);
  light_.contrast += share * (light.contrast - light_.contrast);
}

std::vector<TrackPrediction> FrontEnd::predict(const SE3& now_T_before) const {
  const StereoCamera& camera = calibration_.camera;
  std::vector<cv::Point2d> moved;
  std::vector<TrackPrediction> predictions;
  for (const Track& track : tracks_) {
    Eigen::Vector3d now = now_T_before * track.point;
    now.z() = std::max(now.z(), 1e-3);
    const StereoPixels pixels = camera.project(now);
    moved.emplace_back(pixels[0], pixels[1]);
    predictions.push_back({track.left, static_cast<float>(track.point.z() / now.z())});
  }
  const std::vector<cv::Point2f> pixels = calibration_.left.unrectify(moved);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (calibration_.left.contains(pixels[i])) predictions[i].pixel = pixels[i];
  }
  return predictions;
}

/// Which tracks are in the picture, and where: by their looks where they should be, else where flow has led
/// them.
std::vector<bool> FrontEnd::find(const Picture& left, const std::vector<TrackPrediction>& predictions) {
  const cv::Mat& before = last_->left.pyramid.front();
  std::vector<bool> found;
  std::vector<cv::Point2f> points, guesses;
  std::vector<std::size_t> rest;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    tracks_[i].left_before = tracks_[i].left;
    found.push_back(alignTrack(before, left.image, predictions[i], kPredictionReach, tracks_[i]));
    if (found[i]) continue;
    points.push_back(tracks_[i].left);
    guesses.push_back(predictions[i].pixel);
    rest.push_back(i);
  }
  const Flow flow = followPoints(last_->left, left, points, guesses, kLevels, kMaxFlowRoundTrip);
  for (std::size_t k = 0; k < rest.size(); ++k) {
    if (!flow.found[k]) continue;
    const std::size_t i = rest[k];
    found[i] = true;
    const TrackPrediction there{flow.points[k], predictions[i].magnification};
    if (!alignTrack(before, left.image, there, kFlowReach, tracks_[i]))
      anchorAnew(left.image, flow.points[k], tracks_[i]);
  }
  return found;
}

void FrontEnd::follow(const Picture& left, Stamp stamp) {
  if (tracks_.empty() || !last_) return;
  for (Track& track : tracks_)
    track.point = pointBehind(calibration_.camera, track.left_rectified, track.disparity.value_or(0.0));
  const auto prediction = motion_.predict(last_->stamp, stamp);
  report_.rotation_known = prediction.rotation_known;
  const std::vector<bool> found = find(left, predict(prediction.now_T_before));
  std::size_t i = 0;
  report_.lost = removeTracks(tracks_, [&](const Track&) { return !found[i++]; });
  rectify(tracks_);
  report_.lost += removeTracks(
      tracks_, [this](const Track& track) { return !calibration_.left.shows(track.left_rectified); });
  learnMotion(prediction, stamp);
  // Two that have run together see the same thing; the older one goes on.
  const float nearest = 0.5f * detector_.minDistance();
  std::vector<cv::Point2f> kept;
  report_.lost += removeTracks(tracks_, [&](const Track& track) {
    const bool is_double = std::any_of(kept.begin(), kept.end(),
                                       [&](const auto& p) { return cv::norm(p - track.left) < nearest; });
    if (!is_double) kept.push_back(track.left);
    return is_double;
  });
  report_.followed = tracks_.size();
}

/// Where the tracks are in the rectified picture.
void FrontEnd::rectify(std::vector<Track>& tracks) const {
  std::vector<cv::Point2f> points;
  for (const Track& track : tracks) points.push_back(track.left);
  const auto rectified = calibration_.left.rectify(points);
  const auto magnifications = calibration_.left.magnifications(rectified);
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    tracks[i].left_rectified = rectified[i];
    tracks[i].magnification = magnifications[i];
  }
}

/// How the camera moves against what most tracks see: those that do not see it end, and the others have
/// another disparity.
void FrontEnd::learnMotion(const MotionPredictor::Prediction& prediction, Stamp stamp) {
  const StereoCamera& camera = calibration_.camera;
  const auto displacement = [](const Track& track) {
    return Displacement{track.point, {track.left_rectified.x, track.left_rectified.y}};
  };
  std::vector<Displacement> displacements;
  for (const Track& track : tracks_) {
    if (track.disparity) displacements.push_back(displacement(track));
  }
  const SE3& guess = prediction.now_T_before;
  const double seconds = secondsSinceLast(stamp);
  std::optional<SE3> told;
  if (prediction.rotation_known) told = motion_.withoutBias(guess, seconds);
  const auto motion = estimateMotion(camera, displacements, guess, told);
  motion_.learn(motion, prediction, seconds);
  if (!motion) {
    // What flow alone supports has nothing then that tells it from what is not the same point.
    if (!report_.rotation_known && displacements.size() >= kFewestForMotion)
      report_.lost += removeTracks(tracks_, [](const Track& track) { return track.strayed >= kByFlow; });
    return;
  }
  report_.rejected = removeTracks(tracks_, [&](const Track& track) {
    return track.disparity && misfit(camera, displacement(track), *motion) > kMisfit * track.magnification;
  });
  for (Track& track : tracks_) {
    if (track.disparity) track.disparity = disparityOf(camera, *motion * track.point);
  }
}

void FrontEnd::beginTracks(const Picture& left, Stamp stamp) {
  std::vector<cv::Point2f> occupied;
  for (const Track& track : tracks_) occupied.push_back(track.left);
  const std::size_t few = std::min(kLittleTexture, options_.features);
  if (tracks_.size() < few) detector_.forgetFailures(); // what was blurred or dark may be back
  std::vector<Track> begun;
  for (const cv::Point2f& corner : detector_.detect(left.image, occupied)) {
    begun.emplace_back();
    begun.back().left = corner;
    begun.back().begin = stamp;
  }
  rectify(begun);
  for (Track& track : begun) {
    if (!calibration_.left.shows(track.left_rectified)) {
      detector_.noteFailure(track.left);
      continue;
    }
    track.anchor = AnchorPatch::cut(left.image, track.left);
    tracks_.push_back(std::move(track));
  }
  report_.without_texture = tracks_.size() < few;
}

void FrontEnd::matchTracks(const Picture& left, const Picture& right) {
  std::vector<StereoQuery> queries;
  for (const Track& track : tracks_)
    queries.push_back({track.left, track.left_rectified, track.magnification, track.disparity});
  const auto matches = matcher_.match(left, right, queries);
  RowCount rows;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    Track& track = tracks_[i];
    track.matched = matches[i].found;
    rows.seen += matches[i].found || matches[i].off_row ? 1 : 0;
    rows.off += matches[i].off_row ? 1 : 0;
    track.unmatched = track.matched ? 0 : track.unmatched + 1;
    if (!track.matched) continue;
    ++report_.matched;
    track.right = matches[i].right;
    track.right_rectified = matches[i].right_rectified;
    track.disparity = track.left_rectified.x - track.right_rectified.x;
    // Of twice the variance.
    const double row = (track.left_rectified.y - track.right_rectified.y) / track.magnification;
    const double forget = track.weight < kMaxWeight ? 1.0 : (kMaxWeight - 1.0) / kMaxWeight;
    track.square_sum = forget * track.square_sum + 0.5 * row * row;
    track.weight = forget * track.weight + 1.0;
  }
  // Exchanged cameras stay so until pictures match again: what is left to be looked at becomes ever less.
  if (queries.size() >= kFewestToJudge) {
    const bool fits = 2 * report_.matched > queries.size();
    exchanged_ = !fits && (exchanged_ || matcher_.lookExchanged(left, right, queries));
  }
  report_.exchanged = exchanged_;
  const bool all_are_new =
      std::all_of(tracks_.begin(), tracks_.end(), [](const Track& track) { return track.id == 0; });
  if (all_are_new && rows.seen >= kFewestForRows) rows_ = rows;
  report_.rows = rows_;
  report_.without_matches =
      queries.size() >= kFewestToJudge && kOfWhichMatch * report_.matched < queries.size();
  // A new one without a match has no depth, and may be seen by the left camera alone.
  for (const Track& track : tracks_) {
    if (track.id == 0 && !track.matched) detector_.noteFailure(track.left);
  }
  report_.lost += removeTracks(
      tracks_, [](const Track& track) { return track.id != 0 && track.unmatched > kMaxUnmatched; });
  removeTracks(tracks_, [](const Track& track) { return track.id == 0 && !track.matched; });
  for (Track& track : tracks_) {
    if (track.id != 0) continue;
    track.id = next_id_++;
    ++report_.begun;
  }
}

/// Those that go out for the first time, and those whose descriptor is old.
void FrontEnd::describeTracks(const Picture& left, Stamp stamp) {
  std::vector<Track*> tracks;
  std::vector<cv::Point2f> points;
  for (Track& track : tracks_) {
    if (!track.matched) continue;
    if (track.descriptor && secondsBetween(track.described, stamp) < kDescribed) continue;
    tracks.push_back(&track);
    points.push_back(track.left);
  }
  const auto descriptors = describePoints(left.image, points);
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    tracks[i]->descriptor = descriptors[i];
    tracks[i]->described = stamp;
  }
}

/// `seconds`: since the pair before, over which a filter spreads what a new anchor did to a track.
StereoFrame FrontEnd::features(Stamp stamp, double seconds) const {
  StereoFrame frame{stamp, {}};
  for (const Track& track : tracks_) {
    if (!track.matched) continue;
    const double variance =
        kLifeSigma * kLifeSigma +
        (kPriorWeight * kPriorSigma * kPriorSigma + track.square_sum) / (kPriorWeight + track.weight);
    // As a message holds them.
    const float sigma = static_cast<float>(track.magnification * std::sqrt(variance));
    const double walk = track.strayed > 0.0 ? track.magnification * track.strayed / std::sqrt(seconds) : 0.0;
    frame.features.push_back(
        {track.id,
         {track.left_rectified.x, track.left_rectified.y, track.right_rectified.x, track.right_rectified.y},
         static_cast<double>(sigma),
         static_cast<double>(static_cast<float>(walk)),
         track.descriptor});
  }
  return frame;
}

void FrontEnd::summarise(Stamp stamp) {
  double sum = 0.0;
  for (const Track& track : tracks_) sum += secondsBetween(track.begin, stamp);
  report_.mean_life_s = tracks_.empty() ? 0.0 : sum / static_cast<double>(tracks_.size());
}

} // namespace vi_ekf_slam
