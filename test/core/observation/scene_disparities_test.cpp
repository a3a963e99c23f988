#include "vi_ekf_slam/core/observation/scene_disparities.hpp"

#include <cmath>
#include <vector>

#include "../filter/states.hpp"
#include "vi_ekf_slam/core/filter/innovation.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kSigma = 1.0; // px

struct Seen {
  double truth;
  StereoPixels pixels;
};

/// Of points whose disparities spread about as much as their noise does.
std::vector<Seen> look(Random& random, std::size_t count) {
  std::vector<Seen> all;
  for (std::size_t i = 0; i < count; ++i) {
    const double truth = 5.0 + 1.5 * random.gaussian<1>(1.0)[0], u = random.uniform(100.0, 900.0);
    all.push_back({truth, StereoPixels(u, 200.0, u - truth, 200.0) + random.gaussian<4>(kSigma)});
  }
  return all;
}

std::optional<SceneDisparities> sceneOf(Filter& filter, const std::vector<Seen>& all) {
  std::vector<double> disparities;
  for (const Seen& seen : all) disparities.push_back(seen.pixels[0] - seen.pixels[2]);
  return SceneDisparities::of(filter, disparities, 2.0 * kSigma * kSigma);
}

double disparityOf(const StereoPixels& pixels) { return pixels[0] - pixels[2]; }

TEST(SceneDisparitiesTest, LetFlowTellRotationAndVelocityAtOnceWithoutBias) {
  Random random(21);
  double predicted = 0.0, measured = 0.0;
  constexpr int kScenes = 200, kPoints = 250;
  for (int scene = 0; scene < kScenes; ++scene) {
    const std::vector<Seen> all = look(random, kPoints);
    Filter filter(SE3(), Matrix6d::Identity());
    const auto disparities = sceneOf(filter, all);
    ASSERT_TRUE(disparities);
    // flow = 3 px of rotation + 2 * disparity; least squares of both
    const auto slope = [&all](const auto& regressor) {
      double x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
      for (const Seen& seen : all) {
        const double at = regressor(seen), flow = 3.0 + 2.0 * seen.truth;
        x += at / kPoints, y += flow / kPoints, xx += at * at / kPoints, xy += at * flow / kPoints;
      }
      return (xy - x * y) / (xx - x * x);
    };
    measured += slope([](const Seen& seen) { return disparityOf(seen.pixels); }) / kScenes;
    predicted += slope([&](const Seen& seen) {
                   return disparityOf(disparities->predict(filter, seen.pixels, kSigma).pixels);
                 }) /
                 kScenes;
  }
  EXPECT_NEAR(predicted, 2.0, 0.06); // the variance is that of 250 draws
  EXPECT_LT(measured, 1.2) << "of the disparities themselves";
}

// sum e_i e_j of n errors k noise I + (1 - k)^2 var(mean) 1 1^T, by Sherman and Morrison.
TEST(SceneDisparitiesTest, AreAsWrongAsTheySayTogetherToo) {
  Random random(22);
  constexpr int kScenes = 400, kPoints = 250;
  double each = 0.0, common = 0.0;
  for (int scene = 0; scene < kScenes; ++scene) {
    const std::vector<Seen> all = look(random, kPoints);
    Filter filter(SE3(), Matrix6d::Identity());
    const auto disparities = sceneOf(filter, all);
    ASSERT_TRUE(disparities);
    const double mean_variance =
        filter.covariance()(filter.rowOf(disparities->mean()), filter.rowOf(disparities->mean()));
    double sum = 0.0, own = 0.0, unknown = 0.0;
    for (const Seen& seen : all) {
      const auto start = disparities->predict(filter, seen.pixels, kSigma);
      const double error = seen.truth - disparityOf(start.pixels);
      const Eigen::Vector4d d(1.0, 0.0, -1.0, 0.0);
      own = d.dot(start.noise * d);
      unknown = start.unknown;
      sum += error;
      each += error * error / (own + unknown * unknown * mean_variance) / (kScenes * kPoints);
      const Eigen::Vector4d middle(0.5, 0.0, 0.5, 0.0);
      ASSERT_NEAR(middle.dot(start.noise * middle), 0.5 * kSigma * kSigma, 1e-12);
      ASSERT_NEAR(middle.dot(start.noise * d), 0.0, 1e-12);
    }
    common += sum * sum / (kPoints * own + std::pow(kPoints * unknown, 2) * mean_variance) / kScenes;
  }
  EXPECT_NEAR(each, 1.0, 0.05);
  EXPECT_NEAR(common, 1.0, 3.3 * std::sqrt(2.0 / kScenes));
}

TEST(SceneDisparitiesTest, AreAsMeasuredWhereTheySpreadFarMoreThanTheirNoise) {
  Random random(23);
  Filter filter(SE3(), Matrix6d::Identity());
  std::vector<double> disparities;
  for (int i = 0; i < 100; ++i) disparities.push_back(random.uniform(5.0, 100.0));
  const auto scene = SceneDisparities::of(filter, disparities, 2.0 * 0.01);
  ASSERT_TRUE(scene);
  const StereoPixels pixels(500.0, 200.0, 480.0, 200.5);
  const auto start = scene->predict(filter, pixels, 0.1);
  EXPECT_LT((start.pixels - pixels).norm(), 1e-3);
  EXPECT_LT(start.unknown, 1e-4);
}

TEST(SceneDisparitiesTest, OfAWallAreItsMeanRatherThanTheirNoise) {
  Random random(24);
  Filter filter(SE3(), Matrix6d::Identity());
  std::vector<double> disparities;
  for (int i = 0; i < 100; ++i) disparities.push_back(8.0 + random.gaussian<1>(std::sqrt(2.0))[0]);
  const auto scene = SceneDisparities::of(filter, disparities, 2.0);
  ASSERT_TRUE(scene);
  const auto start = scene->predict(filter, {500.0, 200.0, 488.0, 200.0}, 1.0);
  EXPECT_NEAR(disparityOf(start.pixels), 8.0, 1.5);
  EXPECT_GT(start.unknown, 0.7);
}

TEST(SceneDisparitiesTest, AreNotJudgedByAFew) {
  Filter filter(SE3(), Matrix6d::Identity());
  EXPECT_FALSE(SceneDisparities::of(filter, std::vector<double>(7, 5.0), 1.0));
  EXPECT_EQ(filter.rows(), 6);
}

// Seen in pixels a new point is as uncertain as its own and the mean make it, whatever the calibration is.
TEST(SceneDisparitiesTest, AreInWhatANewPointDependsOn) {
  Random random(25);
  for (const double scale_sigma : {0.0, 0.02}) {
    Scene scene = busyScene(random, 3, scale_sigma);
    StereoModel model = scene.model();
    StereoFrame frame;
    std::vector<std::size_t> features;
    std::vector<double> disparities;
    for (std::size_t i = 0; i < 30; ++i) {
      disparities.push_back(random.uniform(20.0, 26.0));
      features.push_back(i);
      frame.features.push_back(
          {static_cast<FeatureId>(i + 1), {600.0, 200.0, 600.0 - disparities.back(), 200.0}, kSigma});
    }
    Filter other(SE3(), Matrix6d::Identity());
    const auto expected = SceneDisparities::of(other, disparities, 2.0 * kSigma * kSigma);
    const StereoPixels pixels(600.0, 210.0, 580.0, 210.0);
    const auto start = expected->predict(other, pixels, kSigma);
    const double mean_variance = other.covariance()(6, 6);

    const Eigen::Index before = scene.filter.rows();
    model.lookAtScene(scene.filter, frame, features);
    ASSERT_EQ(scene.filter.rows(), before + 1);
    const auto found = model.triangulate(scene.filter, pixels, kSigma);
    ASSERT_TRUE(found);
    const Handle point = scene.filter.augment(Chart::kPoint, found->position, found->noise, found->by);
    const auto seen = model.observe(scene.filter, point, start.pixels, kSigma);
    ASSERT_TRUE(seen);
    EXPECT_LT(seen->residual().norm(), 1e-9);
    const Innovation in(scene.filter.covariance(), {*seen});
    Eigen::Matrix<double, 3, 4> rows = Eigen::Matrix<double, 3, 4>::Zero();
    rows(0, 0) = rows(2, 2) = 1.0;
    rows(1, 1) = rows(1, 3) = 0.5;
    const Eigen::Vector3d by_mean = 0.5 * start.unknown * Eigen::Vector3d(1.0, 0.0, -1.0);
    const Eigen::Matrix3d own = rows * start.noise * rows.transpose();
    EXPECT_LT(distance(Eigen::Matrix3d(in.S(0, 0) - model.noise(kSigma)),
                       Eigen::Matrix3d(own + mean_variance * by_mean * by_mean.transpose())),
              1e-8)
        << scale_sigma;
    model.forgetScene(scene.filter);
    EXPECT_EQ(scene.filter.rows(), before + 3);
  }
}

} // namespace
} // namespace vi_ekf_slam::test
