#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "slanted_plane.hpp"
#include "vi_ekf_slam/front_end/anchor_patch.hpp"

namespace vi_ekf_slam {
namespace {

using Distortion = CameraModel::Distortion;

void expectRoundTrip(const CameraModel& model, double tolerance) {
  std::vector<cv::Point2f> pixels;
  for (int v = 5; v < model.size().height; v += 23)
    for (int u = 5; u < model.size().width; u += 31)
      pixels.emplace_back(static_cast<float>(u), static_cast<float>(v));
  const auto back = model.unrectify(model.rectify(pixels));
  ASSERT_EQ(pixels.size(), back.size());
  for (std::size_t i = 0; i < pixels.size(); ++i)
    EXPECT_LT(cv::norm(pixels[i] - back[i]), tolerance) << pixels[i];
}

CameraModel::Parameters rational() {
  auto p = distortedCalibration(Distortion::kPolynomial).left.parameters();
  p.D = {0.5, 0.1, 1e-4, -2e-4, 0.01, 0.85, 0.2, 0.04};
  return p;
}

TEST(CameraModel, unrectify_undoes_rectify_for_every_distortion) {
  expectRoundTrip(distortedCalibration(Distortion::kPolynomial).right, 1e-3);
  expectRoundTrip(distortedCalibration(Distortion::kEquidistant).right, 1e-3);
  expectRoundTrip(CameraModel(rational()), 1e-3);
  expectRoundTrip(testCalibration().left, 1e-6);
}

/// Where OpenCV's documentation of calib3d says that a direction (x y 1) is seen, with all 14 coefficients.
cv::Point2d seenAt(const CameraModel::Parameters& p, double x, double y) {
  const auto& D = p.D;
  const double r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
  const double radial = (1.0 + D[0] * r2 + D[1] * r4 + D[4] * r6) / (1.0 + D[5] * r2 + D[6] * r4 + D[7] * r6);
  const double u = x * radial + 2.0 * D[2] * x * y + D[3] * (r2 + 2.0 * x * x) + D[8] * r2 + D[9] * r4;
  const double v = y * radial + D[2] * (r2 + 2.0 * y * y) + 2.0 * D[3] * x * y + D[10] * r2 + D[11] * r4;
  const double cx = std::cos(D[12]), sx = std::sin(D[12]), cy = std::cos(D[13]), sy = std::sin(D[13]);
  const cv::Matx33d about_x(1, 0, 0, 0, cx, sx, 0, -sx, cx), about_y(cy, 0, -sy, 0, 1, 0, sy, 0, cy);
  const cv::Matx33d turned = about_y * about_x;
  const cv::Matx33d onto_sensor(turned(2, 2), 0, -turned(0, 2), 0, turned(2, 2), -turned(1, 2), 0, 0, 1);
  const cv::Vec3d pixel = p.K * onto_sensor * turned * cv::Vec3d(u, v, 1.0);
  return {pixel[0] / pixel[2], pixel[1] / pixel[2]};
}

// As OAK cameras state them, most of them with a surplus of zeros.
TEST(CameraModel, rectifies_with_twelve_and_fourteen_coefficients) {
  for (const bool tilted : {false, true}) {
    auto p = rational();
    p.D.insert(p.D.end(), {0.004, -0.002, -0.003, 0.001});
    if (tilted) p.D.insert(p.D.end(), {0.02, -0.03});
    p.R = distortedCalibration(Distortion::kPolynomial).right.parameters().R;
    const CameraModel model(p);
    p.D.resize(14, 0.0);
    for (double x = -0.5; x <= 0.5; x += 0.125) {
      for (double y = -0.4; y <= 0.4; y += 0.1) {
        const cv::Vec3d expected = p.P * p.R * cv::Vec3d(x, y, 1.0);
        const cv::Point2d pixel(expected[0] / expected[2], expected[1] / expected[2]);
        const cv::Point2d raw = seenAt(p, x, y);
        EXPECT_LT(cv::norm(model.rectify({cv::Point2f(raw)}).front() - pixel), 1e-3) << x << ' ' << y;
        EXPECT_LT(cv::norm(cv::Point2d(model.unrectify({pixel}).front()) - raw), 1e-3) << x << ' ' << y;
      }
    }
  }
  auto p = rational();
  const CameraModel eight(p);
  p.D.resize(14, 0.0);
  EXPECT_LT(
      cv::norm(CameraModel(p).rectify({{20.0f, 30.0f}}).front() - eight.rectify({{20.0f, 30.0f}}).front()),
      1e-9);
}

TEST(CameraModel, points_that_the_lens_does_not_show_come_out_far_outside) {
  for (const auto distortion : {Distortion::kPolynomial, Distortion::kEquidistant}) {
    const CameraModel model = distortedCalibration(distortion).left;
    for (const auto& pixel : model.unrectify({{1e5, 0.0}, {-1e5, 1e5}})) EXPECT_FALSE(model.contains(pixel));
  }
}

/// Of a fisheye that sees 97 deg to its sides.
CameraModel wideFisheye() {
  CameraModel::Parameters p;
  p.size = {512, 512};
  p.distortion = Distortion::kEquidistant;
  p.D = {0.0, 0.0, 0.0, 0.0};
  p.K = p.P = {150.0, 0.0, 255.5, 0.0, 150.0, 255.5, 0.0, 0.0, 1.0};
  return CameraModel(p);
}

TEST(CameraModel, a_fisheye_shows_what_a_plane_can_hold_beyond_the_pictures_borders_too) {
  const CameraModel model = wideFisheye();
  const auto at = [&model](double angle) { // rad from the axis
    return model.rectify({{static_cast<float>(255.5 + 150.0 * angle), 255.5f}}).front();
  };
  EXPECT_NEAR(255.5 + 150.0 * std::tan(1.1), at(1.1).x, 1e-3);
  EXPECT_FALSE(model.contains(at(1.1)));
  EXPECT_TRUE(model.shows(at(1.1)));
  for (const double angle : {1.2, 1.5, 1.57, 1.6, 1.7}) EXPECT_FALSE(model.shows(at(angle))) << angle;
  EXPECT_FALSE(testCalibration().left.shows({-1.0, 100.0})); // rectified pictures end where they end
}

TEST(CameraModel, a_pixel_of_a_fisheye_is_as_long_as_the_tangent_stretches_it) {
  const CameraModel model = wideFisheye();
  EXPECT_NEAR(1.0, model.magnifications(model.rectify({{255.5f, 255.5f}})).front(), 1e-3);
  const double expected = std::pow(std::cos(1.0), -2); // 1 rad from the axis: d tan(a)/da, outwards
  const float aslant = 150.0f * std::sqrt(0.5f);
  for (const cv::Point2f& pixel :
       {cv::Point2f(405.5f, 255.5f), {255.5f, 105.5f}, {255.5f + aslant, 255.5f + aslant}})
    EXPECT_NEAR(expected, model.magnifications(model.rectify({pixel})).front(), 1e-3);
  EXPECT_EQ(std::vector<double>({1.0, 1.0}),
            testCalibration().left.magnifications({{1.0f, 2.0f}, {100.0f, 200.0f}}));
}

// The fit of a lens that sees 120 deg turns back on the way to the corners.
TEST(CameraModel, rectifies_as_far_as_a_polynomial_rises_and_no_farther) {
  CameraModel::Parameters p;
  p.size = {640, 480};
  p.D = {-0.38, 0.17, 0.0, 0.0, -0.04};
  p.K = p.P = {380.0, 0.0, 319.5, 0.0, 380.0, 239.5, 0.0, 0.0, 1.0};
  const CameraModel model(p);
  const auto radiusOf = [&p](double tangent) {
    const double t = tangent * tangent;
    return 380.0 * tangent * (1.0 + t * (p.D[0] + t * (p.D[1] + t * p.D[4])));
  };
  const cv::Point2d middle(319.5, 239.5), outwards(0.8, 0.6);
  for (double tangent = 0.05; tangent < 1.3; tangent += 0.05) {
    const cv::Point2f pixel(middle + radiusOf(tangent) * outwards);
    const cv::Point2d rectified = model.rectify({pixel}).front();
    EXPECT_LT(cv::norm(rectified - middle - 380.0 * tangent * outwards), 0.1) << tangent;
    EXPECT_TRUE(model.shows(rectified)) << tangent;
  }
  const double highest = radiusOf(1.37);
  for (double radius = highest + 1.0; radius < 400.0; radius += 5.0) {
    const cv::Point2f pixel(middle + radius * outwards);
    EXPECT_FALSE(model.shows(model.rectify({pixel}).front())) << radius;
  }
}

TEST(CameraModel, says_what_is_rectified_already) {
  EXPECT_FALSE(isRectified(distortedCalibration(Distortion::kPolynomial).left.parameters()));
  CameraModel::Parameters p;
  p.size = {320, 240};
  p.K = p.P = {300.0, 0.0, 159.5, 0.0, 300.0, 119.5, 0.0, 0.0, 1.0};
  p.D = {0.0, 0.0, 0.0, 0.0, 0.0};
  EXPECT_TRUE(isRectified(p));
  p.R(0, 1) = 1e-3;
  EXPECT_FALSE(isRectified(p));
}

TEST(CameraModel, names_what_it_cannot_use) {
  const auto problem = [](const CameraModel::Parameters& p) {
    try {
      const CameraModel model(p);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  auto p = rational();
  p.D.resize(6);
  EXPECT_NE(std::string::npos,
            problem(p).find("D has 6 coefficients, allowed: 4 (equidistant), 0, 4 or 5 (plumb_bob), "
                            "8, 12 or 14 (rational_polynomial)"));
  p = rational();
  p.R(0, 0) = 2.0;
  EXPECT_NE(std::string::npos, problem(p).find("R is not a rotation"));
  p = rational();
  p.K(0, 0) = 0.0;
  EXPECT_NE(std::string::npos, problem(p).find("focal lengths in K must be positive"));
  p = rational();
  p.size = {61, 61};
  EXPECT_EQ("", problem(p));
  p.size = {0, 0};
  EXPECT_NE(std::string::npos, problem(p).find("width x height is 0 x 0, allowed: 61 to 16384 px"));
}

TEST(AnchorPatch, finds_itself_turned_scaled_and_in_other_light) {
  cv::Mat image(200, 200, CV_8UC1);
  cv::RNG(5).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {}, 2.5);
  cv::normalize(image, image, 40, 200, cv::NORM_MINMAX);
  const auto patch = AnchorPatch::cut(image, {100.0f, 90.0f});
  ASSERT_TRUE(patch);
  // 1.04 times as large, turned by 0.05 rad, shifted by fractions of a pixel, brighter with less contrast.
  const float c = 1.04f * std::cos(0.05f), s = 1.04f * std::sin(0.05f);
  const cv::Matx23f warp(c, -s, 100.37f - c * 100 + s * 90, s, c, 89.81f - s * 100 - c * 90);
  cv::Mat moved;
  cv::warpAffine(image, moved, warp, image.size(), cv::INTER_CUBIC);
  moved.convertTo(moved, -1, 0.8, 30.0);
  const auto fit = patch->align(moved, {{100.9f, 89.3f}});
  ASSERT_TRUE(fit);
  EXPECT_NEAR(100.37f, fit->warp.centre.x(), 0.03f);
  EXPECT_NEAR(89.81f, fit->warp.centre.y(), 0.03f);
  EXPECT_NEAR(c, fit->warp.shape(0, 0), 0.02f);
  EXPECT_NEAR(-s, fit->warp.shape(0, 1), 0.02f);
  EXPECT_GT(fit->correlation, 0.99);
}

/// What a camera sees that has driven so far (m) between two walls, 2 m to its left and right, of so many
/// grey levels.
cv::Mat lookAlongWalls(double way, double levels) {
  constexpr double kTexelsPerM = 60.0;
  cv::Mat texture(2048, 2048, CV_8UC1), image;
  cv::RNG(3).fill(texture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(texture, texture, {}, 4.0);
  cv::normalize(texture, texture, 128.0 - 0.5 * levels, 128.0 + 0.5 * levels, cv::NORM_MINMAX);
  cv::Mat map(240, 320, CV_32FC2);
  for (int v = 0; v < map.rows; ++v) {
    for (int u = 0; u < map.cols; ++u) {
      const double depth = 2.0 * kTestCamera.fu / std::abs(u - kTestCamera.cu);
      map.at<cv::Vec2f>(v, u) = {
          static_cast<float>(kTexelsPerM * (depth + way)),
          static_cast<float>(1024.0 + kTexelsPerM * depth * (v - kTestCamera.cv) / kTestCamera.fv)};
    }
  }
  cv::remap(texture, image, map, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  return image;
}

// Of a wall more is seen of what is nearer, and that is to the outside, in each picture anew.
TEST(AnchorPatch, stays_on_points_of_walls_that_come_nearer) {
  struct Followed {
    Eigen::Vector2d at; ///< in the first picture, px from its middle
    AnchorPatch patch;
    AnchorPatch::Warp warp;
  };
  const Eigen::Vector2d middle(kTestCamera.cu, kTestCamera.cv);
  for (const double levels : {200.0, 30.0}) {
    std::vector<Followed> followed;
    const cv::Mat first = lookAlongWalls(0.0, levels);
    for (double u = -90.0; u <= 90.0; u += 6.0) {
      for (double v = -60.0; v <= 60.0 && std::abs(u) >= 60.0; v += 15.0) {
        const Eigen::Vector2f at = (middle + Eigen::Vector2d(u, v)).cast<float>();
        auto patch = AnchorPatch::cut(first, {at.x(), at.y()});
        ASSERT_TRUE(patch);
        followed.push_back({{u, v}, std::move(*patch), {at}});
      }
    }
    double outward = 0.0; // px
    int count = 0;
    for (int k = 1; k <= 10; ++k) {
      const double way = 0.25 * k;
      const cv::Mat image = lookAlongWalls(way, levels);
      for (Followed& f : followed) {
        const double depth = 2.0 * kTestCamera.fu / std::abs(f.at.x());
        const Eigen::Vector2d at = middle + depth / (depth - way) * f.at;
        f.warp.centre = at.cast<float>() + Eigen::Vector2f(0.3f, -0.2f); // as well as flow knows it
        const auto fit = f.patch.align(image, f.warp);
        if (!fit) continue;
        f.warp = fit->warp;
        outward += (fit->warp.centre.x() - at.x()) * (f.at.x() < 0.0 ? -1.0 : 1.0);
        ++count;
      }
    }
    EXPECT_GT(count, 700) << levels << " levels";
    EXPECT_NEAR(0.0, outward / count, 0.02) << levels << " levels";
  }
}

TEST(AnchorPatch, is_nothing_without_contrast_or_beyond_the_image) {
  const cv::Mat grey(100, 100, CV_8UC1, cv::Scalar(90));
  EXPECT_FALSE(AnchorPatch::cut(grey, {50.0f, 50.0f}));
  cv::Mat noise(100, 100, CV_8UC1);
  cv::RNG(1).fill(noise, cv::RNG::UNIFORM, 0, 256);
  EXPECT_FALSE(AnchorPatch::cut(noise, {3.0f, 50.0f}));
  EXPECT_FALSE(AnchorPatch::cut(noise, {std::nanf(""), 50.0f}));
  EXPECT_FALSE(AnchorPatch::cut(noise, {50.0f, 50.0f})->align(grey, {{50.0f, 50.0f}}));
}

} // namespace
} // namespace vi_ekf_slam
