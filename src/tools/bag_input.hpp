#pragma once

#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <functional>
#include <memory>
#include <string>

#include "vi_ekf_slam/ros/bag_structure.hpp"
#include "vi_ekf_slam/ros/intake.hpp"

namespace vi_ekf_slam {

/// The inputs in a bag, in the order of recording.
class BagInput {
 public:
  /// Opens the bag and checks that it has a measurement topic of the right type. Throws BagError.
  BagInput(const std::string& path, const InputTopics& topics);

  /// Hands every message to `intake`. After each, `proceed` hears the share done (0 to 1) and says whether to
  /// go on. Throws BagError where the bag cannot be read on.
  void feed(Intake& intake, const std::function<bool(double)>& proceed);

 private:
  using Handler = std::function<void(const rosbag::MessageInstance&, Intake&)>;

  void checkTopics();
  Handler handlerFor(const std::string& topic) const;

  std::string path_;
  InputTopics topics_;
  rosbag::Bag bag_;
  std::unique_ptr<rosbag::View> view_;
};

} // namespace vi_ekf_slam
