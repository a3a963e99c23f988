#pragma once

#include <opencv2/imgproc.hpp>
#include <vector>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/front_end/front_end.hpp"

namespace vi_ekf_slam {

/// A wall with a random texture that a stereo pair looks at: z = 4 m + 0.3 x + 0.2 y in the frame of the
/// world, in which the camera looks along z. Images are computed exactly but for the texture's interpolation.
class SlantedPlane {
 public:
  explicit SlantedPlane(StereoCalibration calibration, double grain_px = 3.0)
      : calibration_(std::move(calibration)), texture_(2048, 2048, CV_8UC1) {
    cv::RNG random(7);
    random.fill(texture_, cv::RNG::UNIFORM, 0, 256);
    cv::GaussianBlur(texture_, texture_, {}, grain_px);
    cv::normalize(texture_, texture_, 20, 235, cv::NORM_MINMAX);
  }

  const StereoCalibration& calibration() const { return calibration_; }

  /// The pair at world_T_cam, of the rectified left camera.
  StereoImages look(const SE3& world_T_cam, Stamp stamp) const {
    const SE3 right =
        world_T_cam * SE3(Eigen::Matrix3d::Identity(), {calibration_.camera.baseline, 0.0, 0.0});
    return {stamp, render(calibration_.left, world_T_cam), render(calibration_.right, right)};
  }

  /// The point of the wall that the camera sees at this rectified pixel, m.
  Eigen::Vector3d pointAt(const SE3& world_T_cam, const Eigen::Vector2d& pixel) const {
    const StereoCamera& c = calibration_.camera;
    const Eigen::Vector3d ray =
        world_T_cam.rotation() * Eigen::Vector3d((pixel.x() - c.cu) / c.fu, (pixel.y() - c.cv) / c.fv, 1.0);
    const Eigen::Vector3d normal(-0.3, -0.2, 1.0);
    return world_T_cam.translation() +
           (kDistance - normal.dot(world_T_cam.translation())) / normal.dot(ray) * ray;
  }

 private:
  static constexpr double kDistance = 4.0; // m
  static constexpr double kTexelsPerM = 100.0;

  cv::Mat render(const CameraModel& model, const SE3& world_T_cam) const {
    std::vector<cv::Point2f> pixels;
    for (int v = 0; v < model.size().height; ++v)
      for (int u = 0; u < model.size().width; ++u)
        pixels.emplace_back(static_cast<float>(u), static_cast<float>(v));
    const auto rectified = model.rectify(pixels);
    cv::Mat map(model.size(), CV_32FC2), image;
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const Eigen::Vector3d p = pointAt(world_T_cam, {rectified[i].x, rectified[i].y});
      map.at<cv::Vec2f>(static_cast<int>(i) / model.size().width,
                        static_cast<int>(i) % model.size().width) = {
          static_cast<float>(1024.0 + kTexelsPerM * p.x()), static_cast<float>(1024.0 + kTexelsPerM * p.y())};
    }
    cv::remap(texture_, image, map, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
    return image;
  }

  StereoCalibration calibration_;
  cv::Mat texture_;
};

constexpr std::size_t kCount = 60; // tracks that tests ask for
inline const StereoCamera kTestCamera{300.0, 300.0, 159.5, 119.5, 0.2};

/// A pair that is rectified already: P of both, without distortion.
inline StereoCalibration testCalibration() {
  CameraModel::Parameters parameters;
  parameters.size = {320, 240};
  parameters.K = parameters.P = {
      kTestCamera.fu, 0.0, kTestCamera.cu, 0.0, kTestCamera.fv, kTestCamera.cv, 0.0, 0.0, 1.0};
  parameters.images_are_rectified = true;
  return {CameraModel(parameters), CameraModel(parameters), kTestCamera};
}

/// The same pair with lenses that distort and cameras that are not parallel.
inline StereoCalibration distortedCalibration(CameraModel::Distortion distortion) {
  CameraModel::Parameters left;
  left.size = {320, 240};
  left.distortion = distortion;
  left.D = distortion == CameraModel::Distortion::kEquidistant
               ? std::vector<double>{-0.01, 0.02, -0.01, 0.002}
               : std::vector<double>{-0.25, 0.06, 1e-3, -5e-4};
  left.K = {270.0, 0.0, 162.0, 0.0, 272.0, 117.0, 0.0, 0.0, 1.0};
  left.P = {300.0, 0.0, 159.5, 0.0, 300.0, 119.5, 0.0, 0.0, 1.0};
  CameraModel::Parameters right = left;
  right.K = {268.0, 0.0, 158.0, 0.0, 271.0, 121.0, 0.0, 0.0, 1.0};
  const Eigen::Matrix3d turned = so3::Exp({0.01, -0.015, 0.02});
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) right.R(i, j) = turned(i, j);
  return {CameraModel(left), CameraModel(right), kTestCamera};
}

} // namespace vi_ekf_slam
