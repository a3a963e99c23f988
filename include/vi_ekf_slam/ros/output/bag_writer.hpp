#pragma once

#include <rosbag/bag.h>

#include <boost/shared_ptr.hpp>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>

namespace vi_ekf_slam {

/// A bag that cannot be written; the message names the file and the cause.
class BagWriteError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A bag that appears under its name when it is complete and on the disk. Where it does not get so far, as on
/// a full disk, it leaves nothing. All throw BagWriteError.
class BagWriter {
 public:
  explicit BagWriter(const std::string& path);
  ~BagWriter();
  BagWriter(const BagWriter&) = delete;
  BagWriter& operator=(const BagWriter&) = delete;

  /// `connection`: fields of its header; nothing: those of the message.
  template <typename Message>
  void write(const std::string& topic, const ros::Time& time, const Message& message,
             const boost::shared_ptr<ros::M_string>& connection = {}) {
    try {
      bag_->write(topic, time, message, connection);
    } catch (const std::exception& e) {
      fail(e);
    }
  }
  void finish();

 private:
  void abandon() noexcept;
  [[noreturn]] void fail(const std::exception& cause) const;

  std::string path_, temporary_;
  std::unique_ptr<rosbag::Bag> bag_; ///< none after finish()
};

} // namespace vi_ekf_slam
