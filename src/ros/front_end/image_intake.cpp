#include "vi_ekf_slam/ros/front_end/image_intake.hpp"

#include <ctime>
#include <utility>

#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kMostEarly = 20000; // samples
constexpr std::size_t kMostReasons = 50;  // what writes another one each time is not to fill the memory
constexpr const char* kImages = "images: ";
constexpr const char* kLeftAlone = "images: left without a right one";
constexpr const char* kRightAlone = "images: right without a left one";

double threadSeconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

} // namespace

ImageIntake::ImageIntake(const FullConfig& config, const InputTopics& topics, FeatureHandler on_features)
    : config_(config.front_end),
      handlers_{std::move(on_features), {}, {}},
      pairing_({config.front_end.pair_tolerance_s, config.core.buffer.max_delay_s}),
      calibration_(config.front_end.images, topics, config.ros.imu_frame),
      waits_for_rotation_(!topics.imu.empty()) {
  pairing_.expectGyro(!topics.imu.empty());
  updateHold();
}

/// Once the cameras are known.
void ImageIntake::begin() {
  const auto& cameras = calibration_.cameras();
  if (front_end_ || !cameras) return;
  front_end_ = std::make_unique<FrontEnd>(*cameras, FrontEndOptions{config_.features});
  for (const ImuSample& sample : early_) front_end_->addImu(sample);
  early_.clear();
  updateRotation();
  if (!handlers_.calibration) return;
  const auto say = [](const CameraModel& model) { return model.imagesAreRectified() ? "rectified" : "raw"; };
  handlers_.calibration(std::string("left images are taken as ") + say(cameras->left) + ", right ones as " +
                        say(cameras->right) + " (front_end/images)");
}

void ImageIntake::addTransforms(const tf2_msgs::TFMessage& message, bool is_static) {
  calibration_.addTransforms(message, is_static);
  updateRotation();
}

void ImageIntake::updateRotation() {
  if (front_end_ && calibration_.cam_R_imu()) front_end_->setImuRotation(*calibration_.cam_R_imu());
  updateHold();
}

void ImageIntake::updateHold() {
  pairing_.hold(!front_end_ || (!calibration_.cam_R_imu() && waits_for_rotation_));
}

void ImageIntake::add(const sensor_msgs::Imu& message) {
  const auto converted = conversions::toImu(message, calibration_.imuFrame());
  if (!converted.sample) return; // the SLAM node counts and reports these
  calibration_.addImu(message.header);
  if (front_end_) {
    front_end_->addImu(*converted.sample);
  } else {
    early_.push_back(*converted.sample);
    if (early_.size() > kMostEarly) early_.pop_front();
  }
  pairing_.noteGyro(converted.sample->stamp);
  gyro_has_begun_ = true;
  updateRotation();
}

bool ImageIntake::processWaiting() {
  if (!gyro_has_begun_) return false; // it may begin yet
  pairing_.expectGyro(false);
  const bool is_done = processNext();
  pairing_.expectGyro(true);
  return is_done;
}

cv::Mat ImageIntake::decode(const PendingImage& image, const char* side) {
  try {
    return image.decode();
  } catch (const std::exception& e) {
    last_problem_ = std::string(side) + ": " + e.what();
    const std::string reason = kImages + last_problem_;
    if (counts_.turned_away.size() < kMostReasons || counts_.turned_away.count(reason) > 0)
      ++counts_.turned_away[reason];
    return {};
  }
}

bool ImageIntake::process(std::optional<PendingPair> pair) {
  if (!pair) return false;
  if (!front_end_) {
    ++counts_.turned_away["images: no calibration"];
    return true;
  }
  if (!calibration_.cam_R_imu() && waits_for_rotation_) { // it has waited for the transform in vain
    waits_for_rotation_ = false;
    updateHold();
  }
  last_problem_.clear();
  const StereoImages images{pair->left.stamp, decode(pair->left, "left"), decode(pair->right, "right")};
  const double start = threadSeconds();
  const StereoFrame frame = front_end_->process(images);
  last_seconds_ = threadSeconds() - start;
  ++counts_.pairs;
  counts_.features += frame.features.size();
  if (last_problem_.empty()) { // else they could not be decoded, and are of no size
    last_problem_ = problemOf(front_end_->report());
    last_was_used_ = wasUsed(front_end_->report());
    if (!last_problem_.empty() && last_was_used_) ++counts_.flawed["images used: " + last_problem_];
    if (!last_was_used_) ++counts_.turned_away[kImages + last_problem_];
  } else {
    last_was_used_ = false;
  }
  const FrontEndReport& report = front_end_->report();
  if (!report.stamp_refused && !report.sent_twice)
    handlers_.features(conversions::toMessage(frame, leftFrame()));
  if (handlers_.pair) handlers_.pair(images, *front_end_);
  return true;
}

std::string ImageIntake::problem() const {
  const ImagePairing::Counts& counts = pairing_.counts();
  if (counts_.pairs == 0 && counts.without_stamp > 0) return "their header.stamp is 0";
  if (front_end_ && counts_.pairs == 0 && counts.left_alone > 0 && counts.right_alone > 0)
    return "the stamps of left and right images differ by more than " + rounded(config_.pair_tolerance_s) +
           " s (front_end/pair_tolerance_s); are both cameras triggered at once?";
  return calibration_.problem();
}

std::string ImageIntake::mostlyWrong() const {
  const std::uint64_t pairs = counts_.pairs;
  if (pairs == 0) return {};
  const auto say = [](const std::string& reason, std::uint64_t count, std::uint64_t all) {
    return reason + ": " + std::to_string(count) + " of " + std::to_string(all);
  };
  for (const auto& [reason, count] : counts_.turned_away) {
    if (2 * count > pairs) return say(reason, count, pairs) + " pairs";
  }
  const ImagePairing::Counts& counts = pairing_.counts();
  const std::uint64_t left = counts.left_alone, right = counts.right_alone;
  if (left + right <= 2 * pairs) return {}; // as where one camera has half the rate of the other
  return left >= right ? say(kLeftAlone, left, left + pairs) : say(kRightAlone, right, right + pairs);
}

std::map<std::string, std::uint64_t> ImageIntake::turnedAway() const {
  std::map<std::string, std::uint64_t> all = counts_.turned_away;
  const ImagePairing::Counts& counts = pairing_.counts();
  const auto add = [&all](const char* reason, std::uint64_t count) {
    if (count > 0) all[reason] += count;
  };
  add(kLeftAlone, counts.left_alone);
  add(kRightAlone, counts.right_alone);
  add("images: without a stamp", counts.without_stamp);
  add("images: not later than the one before", counts.disordered);
  add("images: pairs without gyro samples", counts.without_gyro);
  add("images: pairs given up for newer ones", counts.shed);
  return all;
}

} // namespace vi_ekf_slam
