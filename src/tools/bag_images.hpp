#pragma once

#include <functional>
#include <map>
#include <memory>
#include <ostream>
#include <string>

#include "bag_input.hpp"
#include "feature_bag.hpp"
#include "run_bag_options.hpp"
#include "vi_ekf_slam/ros/front_end/image_intake.hpp"

namespace vi_ekf_slam {

/// The images of a bag, made into features on their way to the intake.
class BagImages {
 public:
  /// Whether the bag has both images, raw or compressed, and no features.
  static bool isNeeded(const RunBagOptions& options, const BagInput& input);

  /// `input` and `intake` must outlive this, and `input` is to be fed while this lives. Throws BagError where
  /// a topic is of the wrong type, BagWriteError where the bag of features cannot be made.
  BagImages(const RunBagOptions& options, const FullConfig& config, BagInput& input, Intake& intake);

  void onCalibration(std::function<void(const std::string&)> handler) {
    images_.onCalibration(std::move(handler));
  }
  /// The bag is over: what waits is processed, and the bag of features is complete.
  void finish();

  /// What kept the images, or most of them, from being used; empty: nothing.
  std::string problem() const {
    const std::string problem = images_.problem();
    return problem.empty() ? images_.mostlyWrong() : "images were not used: " + problem;
  }
  std::map<std::string, std::uint64_t> turnedAway() const { return images_.turnedAway(); }
  /// One line on what was made.
  void print(std::ostream& out) const;

 private:
  void listenToImages(const std::string& topic, bool is_left);
  void advance();

  BagInput& input_;
  ImageIntake images_;
  std::unique_ptr<FeatureBag> saved_;  ///< nothing: not wanted
  std::uint64_t time_ = 0;             ///< ns, of recording of the message in hand
  double seconds_ = 0.0;               ///< of CPU time
  double tracks_ = 0.0, life_s_ = 0.0; ///< sums over the pairs: tracks, and s of their mean age
};

} // namespace vi_ekf_slam
