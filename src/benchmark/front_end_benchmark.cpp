/// CPU time of the front end for a pair of raw images of several sizes, in one thread. On a recorded drive
/// run_bag prints it.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/front_end/front_end.hpp"

namespace vi_ekf_slam {
namespace {

constexpr int kFrames = 40;

/// Cameras of `width` x `height` px with lenses that distort, 0.11 m apart.
StereoCalibration calibrationOf(int width, int height, CameraModel::Distortion distortion) {
  const bool is_fisheye = distortion == CameraModel::Distortion::kEquidistant;
  const double focal = (is_fisheye ? 0.35 : 0.6) * width;
  CameraModel::Parameters left;
  left.size = {width, height};
  left.distortion = distortion;
  left.D = is_fisheye ? std::vector<double>{-0.01, 0.02, -0.01, 0.002}
                      : std::vector<double>{-0.25, 0.06, 1e-3, -5e-4};
  left.K = {focal, 0.0, 0.5 * width, 0.0, focal, 0.5 * height, 0.0, 0.0, 1.0};
  left.P = left.K;
  CameraModel::Parameters right = left;
  const Eigen::Matrix3d turned = so3::Exp({0.002, -0.003, 0.004});
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) right.R(row, column) = turned(row, column);
  }
  return {CameraModel(left), CameraModel(right), {focal, focal, 0.5 * width, 0.5 * height, 0.11}};
}

/// What a camera sees that moves sideways and towards a wall which rises from 2 m at its left to 6 m at its
/// right.
std::vector<StereoImages> drive(const StereoCalibration& calibration) {
  cv::Mat texture(2048, 4096, CV_8UC1);
  cv::RNG random(7);
  random.fill(texture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(texture, texture, {}, 2.5);
  cv::normalize(texture, texture, 20, 235, cv::NORM_MINMAX);
  const auto raysOf = [&](const CameraModel& model) {
    std::vector<cv::Point2f> pixels;
    for (int v = 0; v < model.size().height; ++v) {
      for (int u = 0; u < model.size().width; ++u)
        pixels.emplace_back(static_cast<float>(u), static_cast<float>(v));
    }
    return model.rectify(pixels);
  };
  const auto left_rays = raysOf(calibration.left), right_rays = raysOf(calibration.right);
  const StereoCamera& c = calibration.camera;
  const double texels = c.fu / 2.5; // a m: about a texel a pixel
  const auto render = [&](const std::vector<cv::Point2d>& rays, const CameraModel& model, double x,
                          double z) {
    cv::Mat map(model.size(), CV_32FC2), image;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const double a = (rays[i].x - c.cu) / c.fu, b = (rays[i].y - c.cv) / c.fv;
      const double depth = (4.0 + 0.8 * x - z) / std::max(0.2, 1.0 - 0.8 * a);
      map.at<cv::Vec2f>(static_cast<int>(i) / model.size().width,
                        static_cast<int>(i) % model.size().width) = {
          static_cast<float>(2048.0 + texels * (x + a * depth)),
          static_cast<float>(1024.0 + texels * b * depth)};
    }
    cv::remap(texture, image, map, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
    cv::Mat noise(image.size(), CV_8UC1);
    random.fill(noise, cv::RNG::NORMAL, 4, 2);
    return cv::Mat(image + noise - 4);
  };
  std::vector<StereoImages> images;
  for (int k = 0; k < kFrames; ++k) {
    const double x = 0.02 * k, z = 0.015 * k;
    images.push_back({(k + 1) * Stamp{50'000'000}, render(left_rays, calibration.left, x, z),
                      render(right_rays, calibration.right, x + c.baseline, z)});
  }
  return images;
}

/// Arguments: width, height, whether the lens is a fisheye, features.
void pairOfImages(benchmark::State& run) {
  cv::setNumThreads(1);
  const auto calibration = calibrationOf(
      static_cast<int>(run.range(0)), static_cast<int>(run.range(1)),
      run.range(2) != 0 ? CameraModel::Distortion::kEquidistant : CameraModel::Distortion::kPolynomial);
  const auto images = drive(calibration);
  const FrontEndOptions options{static_cast<std::size_t>(run.range(3))};
  auto front_end = std::make_unique<FrontEnd>(calibration, options);
  std::size_t next = 0, features = 0;
  for (auto _ : run) {
    if (next == images.size()) {
      run.PauseTiming();
      next = 0;
      front_end = std::make_unique<FrontEnd>(calibration, options);
      run.ResumeTiming();
    }
    features += front_end->process(images[next++]).features.size();
  }
  run.counters["features"] = static_cast<double>(features) / static_cast<double>(run.iterations());
}

BENCHMARK(pairOfImages)
    ->ArgNames({"width", "height", "fisheye", "tracks"})
    ->Args({752, 480, 0, 130})
    ->Args({1392, 512, 0, 130})
    ->Args({1024, 1024, 1, 130})
    ->Unit(benchmark::kMillisecond);

} // namespace
} // namespace vi_ekf_slam

BENCHMARK_MAIN();
