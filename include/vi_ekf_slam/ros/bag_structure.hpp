#pragma once

#include <rosbag/bag.h>

#include <stdexcept>
#include <string>

namespace vi_ekf_slam {

/// A bag that cannot be used, wholly or from some point on; what() names the bag and the cause.
class BagError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Reads the bag from its first to its last byte and throws BagError unless its records fit into each other:
/// sizes, the positions in its index, the chunks' content after unpacking. rosbag itself believes what a file
/// says, and with one that is damaged or made to harm it reads beyond its buffers, asks for any amount of
/// memory, or loads the plugin that the bag names. Holds one chunk at a time.
void checkBagStructure(const std::string& path);

/// Opens the bag for reading once its structure is checked. Throws BagError.
void openCheckedBag(rosbag::Bag& bag, const std::string& path);

} // namespace vi_ekf_slam
