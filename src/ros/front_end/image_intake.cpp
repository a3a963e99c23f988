#include "vi_ekf_slam/ros/front_end/image_intake.hpp"

#include <algorithm>
#include <ctime>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kMostEarly = 20000; // samples
constexpr std::size_t kMostReasons = 50;  // what writes another one each time is not to fill the memory

double threadSeconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

template <std::size_t N>
cv::Matx33d columns3(const boost::array<double, N>& row_major, std::size_t stride) {
  cv::Matx33d matrix;
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column)
      matrix(static_cast<int>(row), static_cast<int>(column)) = row_major[row * stride + column];
  }
  return matrix;
}

/// Throws std::invalid_argument.
CameraModel cameraModel(const sensor_msgs::CameraInfo& info, ImageKind images) {
  CameraModel::Parameters p;
  p.size = {static_cast<int>(std::min(info.width, 65536u)), static_cast<int>(std::min(info.height, 65536u))};
  p.D = info.D;
  p.K = columns3(info.K, 3);
  p.P = columns3(info.P, 4);
  const Eigen::Matrix3d R = rectification(info);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) p.R(row, column) = R(row, column);
  }
  const std::string& model = info.distortion_model;
  if (model == "equidistant" || model == "fisheye") {
    p.distortion = CameraModel::Distortion::kEquidistant;
  } else if (model != "plumb_bob" && model != "rational_polynomial" && !(model.empty() && p.D.empty()) &&
             images != ImageKind::kRectified) {
    throw std::invalid_argument("distortion_model is '" + model +
                                "', allowed: plumb_bob, rational_polynomial, equidistant");
  }
  p.images_are_rectified = images == ImageKind::kRectified || (images == ImageKind::kAuto && isRectified(p));
  return CameraModel(p);
}

} // namespace

std::optional<StereoCalibration> stereoCalibration(const sensor_msgs::CameraInfo& left,
                                                   const sensor_msgs::CameraInfo& right, ImageKind images,
                                                   const InputTopics& topics, std::string& problem) {
  problem = stereoProblem(left, right, topics.left_info, topics.right_info);
  if (!problem.empty()) return std::nullopt;
  const auto modelOf = [&](const sensor_msgs::CameraInfo& info, const std::string& topic) {
    try {
      return CameraModel(cameraModel(info, images));
    } catch (const std::exception& e) {
      throw std::invalid_argument(topic + ": " + e.what());
    }
  };
  try {
    return StereoCalibration{modelOf(left, topics.left_info), modelOf(right, topics.right_info),
                             stereoCamera(left, right)};
  } catch (const std::exception& e) {
    problem = e.what();
    return std::nullopt;
  }
}

ImageIntake::ImageIntake(const FullConfig& config, const InputTopics& topics, FeatureHandler on_features)
    : config_(config),
      topics_(topics),
      on_features_(std::move(on_features)),
      pairing_({config.front_end.pair_tolerance_s, config.core.buffer.max_delay_s}),
      imu_frame_(config.ros.imu_frame),
      waits_for_rotation_(!topics.imu.empty()) {
  pairing_.expectGyro(!topics.imu.empty());
  updateHold();
}

template <typename MessagePtr>
PendingImage ImageIntake::pending(const MessagePtr& message) {
  const auto decode = [this, message] {
    if constexpr (std::is_same_v<MessagePtr, sensor_msgs::ImageConstPtr>) {
      return decoder_.decode(message);
    } else {
      return decoder_.decode(*message);
    }
  };
  return {conversions::toStamp(message->header.stamp), decode};
}
template PendingImage ImageIntake::pending(const sensor_msgs::ImageConstPtr&);
template PendingImage ImageIntake::pending(const sensor_msgs::CompressedImageConstPtr&);

void ImageIntake::addLeftInfo(const sensor_msgs::CameraInfo& message) {
  if (front_end_) return;
  left_info_ = message;
  calibrate();
}

void ImageIntake::addRightInfo(const sensor_msgs::CameraInfo& message) {
  if (front_end_) return;
  right_info_ = message;
  calibrate();
}

void ImageIntake::calibrate() {
  if (!left_info_ || !right_info_) return;
  auto calibration =
      stereoCalibration(*left_info_, *right_info_, config_.front_end.images, topics_, calibration_problem_);
  left_frame_ = conversions::frameName(left_info_->header.frame_id);
  if (calibration && left_frame_.empty())
    calibration_problem_ = "frame_id of " + topics_.left_info + " is empty";
  if (!calibration_problem_.empty()) return;
  front_end_ = std::make_unique<FrontEnd>(*calibration, FrontEndOptions{config_.front_end.features});
  rectification_ = rectification(*left_info_);
  for (const ImuSample& sample : early_) front_end_->addImu(sample);
  early_.clear();
  updateTransform();
  if (!on_calibration_) return;
  const auto say = [](const CameraModel& model) { return model.imagesAreRectified() ? "rectified" : "raw"; };
  on_calibration_(std::string("left images are taken as ") + say(calibration->left) + ", right ones as " +
                  say(calibration->right) + " (front_end/images)");
}

void ImageIntake::addTransforms(const tf2_msgs::TFMessage& message, bool is_static) {
  frames_.add(message, is_static);
  updateTransform();
}

void ImageIntake::updateTransform() {
  if (front_end_ && !has_rotation_ && !imu_frame_.empty()) {
    if (const auto cam_T_imu = frames_.find(left_frame_, imu_frame_)) {
      front_end_->setImuRotation(rectification_ * cam_T_imu->rotation());
      has_rotation_ = true;
    }
  }
  updateHold();
}

void ImageIntake::updateHold() { pairing_.hold(!front_end_ || (!has_rotation_ && waits_for_rotation_)); }

void ImageIntake::add(const sensor_msgs::Imu& message) {
  const auto converted = conversions::toImu(message, imu_frame_);
  if (!converted.sample) return; // the SLAM node counts and reports these
  if (imu_frame_.empty()) imu_frame_ = conversions::frameName(message.header.frame_id);
  if (front_end_) {
    front_end_->addImu(*converted.sample);
  } else {
    early_.push_back(*converted.sample);
    if (early_.size() > kMostEarly) early_.pop_front();
  }
  pairing_.noteGyro(converted.sample->stamp);
  updateTransform();
}

cv::Mat ImageIntake::decode(const PendingImage& image, const char* side) {
  try {
    return image.decode();
  } catch (const std::exception& e) {
    const std::string reason = std::string("images: ") + side + ": " + e.what();
    if (turned_away_.size() < kMostReasons || turned_away_.count(reason) > 0) ++turned_away_[reason];
    return {};
  }
}

bool ImageIntake::process(std::optional<PendingPair> pair) {
  if (!pair) return false;
  if (!front_end_) {
    ++turned_away_["images: no calibration"];
    return true;
  }
  if (!has_rotation_ && waits_for_rotation_) { // it has waited for the transform in vain
    waits_for_rotation_ = false;
    updateHold();
  }
  const StereoImages images{pair->left.stamp, decode(pair->left, "left"), decode(pair->right, "right")};
  const double start = threadSeconds();
  const StereoFrame frame = front_end_->process(images);
  last_seconds_ = threadSeconds() - start;
  ++pairs_;
  features_ += frame.features.size();
  if (const std::string reason = problemOf(front_end_->report()); !reason.empty())
    ++turned_away_["images: " + reason];
  if (!front_end_->report().stamp_refused) on_features_(conversions::toMessage(frame, left_frame_));
  if (on_pair_) on_pair_(images, *front_end_);
  return true;
}

std::string ImageIntake::problem() const {
  const ImagePairing::Counts& counts = pairing_.counts();
  if (front_end_ && pairs_ == 0 && counts.left_alone > 0 && counts.right_alone > 0)
    return "the stamps of left and right images differ by more than " +
           rounded(config_.front_end.pair_tolerance_s) +
           " s (front_end/pair_tolerance_s); are both cameras triggered at once?";
  if (front_end_) return {};
  if (!left_info_) return "no sensor_msgs/CameraInfo on " + topics_.left_info;
  if (!right_info_) return "no sensor_msgs/CameraInfo on " + topics_.right_info;
  return calibration_problem_;
}

std::string ImageIntake::mostlyWrong() const {
  for (const auto& [reason, count] : turned_away_) {
    if (pairs_ > 0 && 2 * count > pairs_)
      return reason + ": " + std::to_string(count) + " of " + std::to_string(pairs_) + " pairs";
  }
  return {};
}

std::map<std::string, std::uint64_t> ImageIntake::turnedAway() const {
  std::map<std::string, std::uint64_t> all = turned_away_;
  const ImagePairing::Counts& counts = pairing_.counts();
  const auto add = [&all](const char* reason, std::uint64_t count) {
    if (count > 0) all[reason] += count;
  };
  add("images: left without a right one", counts.left_alone);
  add("images: right without a left one", counts.right_alone);
  add("images: not later than the one before", counts.disordered);
  add("images: pairs without gyro samples", counts.without_gyro);
  add("images: pairs given up for newer ones", counts.shed);
  return all;
}

} // namespace vi_ekf_slam
