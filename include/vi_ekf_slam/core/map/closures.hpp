#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "vi_ekf_slam/core/map/place_loops.hpp"
#include "vi_ekf_slam/core/map/relocaliser.hpp"
#include "vi_ekf_slam/core/map/returning_landmarks.hpp"

namespace vi_ekf_slam {

/// All by which the present drive is tied to what is known of places from before: ids that return, places
/// that are recognised, and a saved map.
class Closures {
 public:
  explicit Closures(bool recognise_places) : recognise_places_(recognise_places) {}

  /// After the frame of the report; `seconds` have passed since the last one.
  void update(Filter& filter, LandmarkMap& map, const StereoModel& model, double seconds,
              FrameReport& report) {
    map.bound(filter);
    report.revisited += returning_.update(filter, map, model, report.stamp, seconds);
    if (recognise_places_) report.place_recognised = places_.update(filter, map, report.stamp, seconds);
    report.relocalised = relocaliser_ && relocaliser_->update(filter, map, returning_, model, report.stamp);
    if (!report.relocalised) return;
    relocaliser_.reset();
    use_ = MapUse::kRelocalised;
  }
  void restart() { returning_.restart(); }

  /// Somebody says where in the saved map the vehicle is, see Relocaliser::placeAt.
  bool placeIn(Filter& filter, LandmarkMap& map, const SE3& pose, const Matrix6d& covariance) {
    if (!relocaliser_ || !relocaliser_->placeAt(pose, covariance, filter, map)) return false;
    returning_.restart();
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
  bool recognise_places_;
  ReturningLandmarks returning_;
  PlaceLoops places_;
  std::optional<Relocaliser> relocaliser_;
  std::optional<Resume> resume_;
  MapUse use_ = MapUse::kNone;
};

} // namespace vi_ekf_slam
