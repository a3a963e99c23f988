#include "vi_ekf_slam/ros/front_end/pair_calibration.hpp"

#include <algorithm>
#include <stdexcept>

namespace vi_ekf_slam {
namespace {

/// Throws std::invalid_argument.
CameraModel cameraModel(const sensor_msgs::CameraInfo& info, ImageKind images) {
  CameraModel::Parameters p;
  p.size = {static_cast<int>(std::min(info.width, 65536u)), static_cast<int>(std::min(info.height, 65536u))};
  p.D = info.D;
  p.K = cv::Matx33d(info.K.data());
  p.P = cv::Matx34d(info.P.data()).get_minor<3, 3>(0, 0);
  p.R = cv::Matx33d(rectification(info).data()).t(); // Eigen's are column by column
  const std::string& model = info.distortion_model;
  const bool is_without = std::all_of(p.D.begin(), p.D.end(), [](double d) { return d == 0.0; });
  if (model == "equidistant" || model == "fisheye") {
    p.distortion = CameraModel::Distortion::kEquidistant;
    while (p.D.size() > 4 && p.D.back() == 0.0) p.D.pop_back(); // as a RealSense T265 has it
  } else if (model != "plumb_bob" && model != "rational_polynomial" && !(model.empty() && is_without) &&
             images != ImageKind::kRectified) {
    throw std::invalid_argument(
        "distortion_model is '" + model + "', allowed: plumb_bob, rational_polynomial, equidistant" +
        (is_without ? "; empty where D is 0; any with front_end/images: rectified" : ""));
  }
  p.images_are_rectified = images == ImageKind::kRectified || (images == ImageKind::kAuto && isRectified(p));
  return CameraModel(p);
}

/// Optical flow leads from the one picture into the other. Throws std::invalid_argument.
void requireOneSize(const StereoCalibration& calibration) {
  const cv::Size left = calibration.left.size(), right = calibration.right.size();
  const auto say = [](const cv::Size& size) {
    return std::to_string(size.width) + " x " + std::to_string(size.height);
  };
  if (left != right)
    throw std::invalid_argument("left pictures are " + say(left) + ", right ones " + say(right) +
                                ", allowed: the same size (scale one, with its K)");
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
    const StereoCalibration calibration{modelOf(left, topics.left_info), modelOf(right, topics.right_info),
                                        stereoCamera(left, right)};
    requireOneSize(calibration);
    return calibration;
  } catch (const std::exception& e) {
    problem = e.what();
    return std::nullopt;
  }
}

void PairCalibration::addLeft(const sensor_msgs::CameraInfo& info) {
  if (cameras_) return;
  left_ = info;
  left_frame_ = conversions::frameName(info.header.frame_id);
  updateCameras();
}

void PairCalibration::addRight(const sensor_msgs::CameraInfo& info) {
  if (cameras_) return;
  right_ = info;
  updateCameras();
}

void PairCalibration::addTransforms(const tf2_msgs::TFMessage& message, bool is_static) {
  // That one holds, and without an IMU none is looked for; after a jump back of time tf2 complains of each
  // transform of /tf, which comes again.
  if (cam_R_imu_ || (!is_static && imu_frame_.empty())) return;
  frames_.add(message, is_static);
  updateRotation();
}

void PairCalibration::addImu(const std_msgs::Header& header) {
  if (!imu_frame_.empty()) return;
  imu_frame_ = conversions::frameName(header.frame_id);
  updateRotation();
}

std::string PairCalibration::problem() const {
  if (!left_) return "no sensor_msgs/CameraInfo on " + topics_.left_info;
  if (!right_) return "no sensor_msgs/CameraInfo on " + topics_.right_info;
  return problem_;
}

void PairCalibration::updateCameras() {
  if (!left_ || !right_) return;
  auto cameras = stereoCalibration(*left_, *right_, images_, topics_, problem_);
  if (cameras && left_frame_.empty()) problem_ = "frame_id of " + topics_.left_info + " is empty";
  if (!problem_.empty()) return;
  cameras_ = std::move(cameras);
  updateRotation();
}

void PairCalibration::updateRotation() {
  if (!cameras_ || cam_R_imu_ || imu_frame_.empty()) return;
  if (const auto cam_T_imu = frames_.find(left_frame_, imu_frame_))
    cam_R_imu_ = rectification(*left_) * cam_T_imu->rotation();
}

} // namespace vi_ekf_slam
