#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "vi_ekf_slam/core/health/frame_report.hpp"
#include "vi_ekf_slam/core/loops/appearance_claims.hpp"
#include "vi_ekf_slam/core/loops/appearance_loops.hpp"
#include "vi_ekf_slam/core/loops/place_loops.hpp"
#include "vi_ekf_slam/core/loops/place_recognition.hpp"
#include "vi_ekf_slam/core/loops/relocaliser.hpp"
#include "vi_ekf_slam/core/loops/returning_landmarks.hpp"
#include "vi_ekf_slam/core/loops/settling.hpp"

namespace vi_ekf_slam {

/// All by which the present drive is tied to what is known of places from before: ids that return, places
/// that are recognised, and a saved map.
class Closures {
 public:
  explicit Closures(PlaceRecognition recognition) : recognition_(recognition) {}

  /// After the frame of the report. What the loop says that it has closed, if any: of several the one of the
  /// most landmarks.
  Revisit update(Filter& filter, LandmarkMap& map, const StereoModel& model, FrameReport& report) {
    settling_.advance(filter, report.stamp);
    Revisit revisit = returning_.update(filter, map, report.stamp, settling_);
    report.revisited += revisit.landmarks;
    const auto recognised = [&](const Revisit& place) {
      report.place_recognised |= place.landmarks > 0;
      if (place.landmarks > revisit.landmarks) revisit = place;
      return place.landmarks;
    };
    if (recognition_ != PlaceRecognition::kNone)
      report.revisited += recognised(by_appearance_.update(filter, map, report.stamp, settling_));
    if (recognition_ == PlaceRecognition::kConstellation)
      recognised(by_constellation_.update(filter, map, report.stamp, settling_));
    lookAhead(filter, map, model, report.stamp, settling_);
    report.relocalised = relocaliser_ && relocaliser_->update(filter, map, returning_, report.stamp);
    if (!report.relocalised) return revisit;
    by_appearance_.restart();
    by_constellation_.restart();
    relocaliser_.reset();
    use_ = MapUse::kRelocalised;
    return {};
  }
  /// Before the frame's features are associated.
  void expect(Filter& filter, LandmarkMap& map, const StereoModel& model, const StereoFrame& frame,
              const std::vector<std::size_t>& usable) {
    ReturningLandmarks::recognise(filter, map, frame, usable);
    if (recognition_ != PlaceRecognition::kNone) claimExpected(filter, map, model, frame, usable);
  }
  void restart() {
    returning_.restart();
    by_appearance_.restart();
    by_constellation_.restart();
  }

  /// Somebody says where in the saved map the vehicle is, see Relocaliser::placeAt.
  bool placeIn(Filter& filter, LandmarkMap& map, const SE3& pose, const Matrix6d& covariance) {
    if (!relocaliser_ || !relocaliser_->placeAt(pose, covariance, filter, map)) return false;
    restart();
    relocaliser_.reset();
    use_ = MapUse::kRelocalised;
    return true;
  }

  void relocaliseIn(std::shared_ptr<const SavedMap> map) {
    relocaliser_.emplace(std::move(map));
    use_ = MapUse::kWaiting;
  }

  /// A saved map to go on from with the first measurement, if that comes soon enough.
  struct Resume {
    std::shared_ptr<const SavedMap> map;
    double max_gap_s;
  };
  void resumeFrom(Resume resume) {
    resume_ = std::move(resume);
    use_ = MapUse::kWaiting;
  }
  std::optional<Resume> takeResume() { return std::exchange(resume_, std::nullopt); }
  void noteResumed() { use_ = MapUse::kResumed; }
  MapUse use() const { return use_; }

 private:
  PlaceRecognition recognition_;
  Settling settling_;
  ReturningLandmarks returning_;
  AppearanceLoops by_appearance_;
  PlaceLoops by_constellation_;
  std::optional<Relocaliser> relocaliser_;
  std::optional<Resume> resume_;
  MapUse use_ = MapUse::kNone;
};

} // namespace vi_ekf_slam
