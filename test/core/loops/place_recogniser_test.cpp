#include "vi_ekf_slam/core/loops/place_recogniser.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "../../sanitized.hpp"
#include "../numeric.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kPositionSigma = 3.0, kRotationSigma = 0.03; // of the pose against what was seen before

Matrix6d uncertainty() {
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(kPositionSigma * kPositionSigma);
  covariance.diagonal().tail<3>().setConstant(kRotationSigma * kRotationSigma);
  return covariance;
}

/// A street along x: houses 12 m apart that look alike from afar (windows on a raster, a pole before each),
/// in detail as chance wants.
class HouseRow {
 public:
  explicit HouseRow(unsigned seed) : engine_(seed) {
    for (double x = -40.0; x < 40.0; x += 12.0) {
      for (const double side : {-9.0, 9.0}) {
        for (int window = 0; window < 12; ++window)
          corners_.push_back({x + 2.5 * (window % 4) + 0.4 * normal(), side + 0.2 * normal(),
                              1.5 + 2.8 * (window / 4) + 0.4 * normal()});
        for (int i = 0; i < 6; ++i)
          corners_.push_back({x + 12.0 * uniform(), 0.6 * side * uniform(), 1.5 * uniform()});
        for (int i = 0; i < 3; ++i)
          corners_.push_back({x + 5.0 + 0.1 * normal(), 0.55 * side, 5.0 * uniform()});
      }
    }
  }

  /// What one pass sees: `share` of the corners, each where it is but for `sigma` m, moved by
  /// `pass_T_street`.
  std::vector<PlacePoint> pass(double share, double sigma, const SE3& pass_T_street, FeatureId first) {
    std::vector<PlacePoint> seen;
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      if (uniform() > share) continue;
      seen.push_back(
          {first + i, pass_T_street * (corners_[i] + sigma * Eigen::Vector3d(normal(), normal(), normal()))});
    }
    return seen;
  }

  /// A pose error as the uncertainty has it.
  SE3 error() {
    return SE3(so3::Exp(kRotationSigma * Eigen::Vector3d(normal(), normal(), normal())),
               kPositionSigma * Eigen::Vector3d(normal(), normal(), 0.5 * normal()));
  }

 private:
  double normal() { return std::normal_distribution<double>()(engine_); }
  double uniform() { return std::uniform_real_distribution<double>()(engine_); }

  std::mt19937 engine_;
  std::vector<Eigen::Vector3d> corners_;
};

TEST(PlaceRecogniser, FindsTheStreetAgain) {
  int found = 0;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    HouseRow street(seed);
    const SE3 now_T_before = street.error();
    const auto before = street.pass(0.6, 0.1, SE3(), 0), now = street.pass(0.6, 0.1, now_T_before, 1000);
    const auto recognition = recognisePlace(now, before, Eigen::Vector3d::Zero(), uncertainty());
    if (!recognition) continue;
    ++found;
    const SE3 left = recognition->before_T_now * now_T_before;
    EXPECT_LT(left.translation().norm(), 0.25) << seed;
    EXPECT_LT(so3::Log(left.rotation()).norm(), 0.02) << seed;
    std::size_t right = 0;
    std::set<FeatureId> taken;
    for (const auto& [seen_now, seen_before] : recognition->matches) {
      right += seen_now == seen_before + 1000 ? 1 : 0;
      EXPECT_TRUE(taken.insert(seen_before).second);
    }
    EXPECT_GT(static_cast<double>(right), 0.6 * static_cast<double>(recognition->matches.size())) << seed;
  }
  EXPECT_GE(found, 36);
}

TEST(PlaceRecogniser, IsNotTakenInByParallelStreets) {
  int found = 0;
  for (unsigned seed = 1; seed <= (kSanitized ? 10u : 100u); ++seed) {
    HouseRow one(seed), other(1000 + seed);
    const auto before = one.pass(0.6, 0.1, SE3(), 0), now = other.pass(0.6, 0.1, other.error(), 1000);
    if (recognisePlace(now, before, Eigen::Vector3d::Zero(), uncertainty())) ++found;
  }
  EXPECT_EQ(found, 0);
}

TEST(PlaceRecogniser, DoesNotBelieveWhatThePoseMakesImpossible) {
  HouseRow street(7);
  const auto before = street.pass(0.8, 0.05, SE3(), 0);
  for (const SE3& away : {SE3(Eigen::Matrix3d::Identity(), {25.0, 0.0, 0.0}),
                          SE3(so3::Exp(Eigen::Vector3d(0.0, 0.0, 0.3)), Eigen::Vector3d::Zero())}) {
    const auto now = street.pass(0.8, 0.05, away, 1000);
    EXPECT_FALSE(recognisePlace(now, before, Eigen::Vector3d::Zero(), uncertainty()));
  }
}

TEST(PlaceRecogniser, WantsEnoughToGoBy) {
  HouseRow street(8);
  auto before = street.pass(1.0, 0.0, SE3(), 0), now = street.pass(1.0, 0.0, SE3(), 1000);
  EXPECT_TRUE(recognisePlace(now, before, Eigen::Vector3d::Zero(), uncertainty()));
  now.resize(39);
  EXPECT_FALSE(recognisePlace(now, before, Eigen::Vector3d::Zero(), uncertainty()));
  EXPECT_FALSE(recognisePlace({}, {}, Eigen::Vector3d::Zero(), uncertainty()));
}

TEST(PlaceRecogniser, RepeatsItself) {
  HouseRow street(9);
  const auto before = street.pass(0.6, 0.1, SE3(), 0), now = street.pass(0.6, 0.1, street.error(), 1000);
  const auto once = recognisePlace(now, before, Eigen::Vector3d::Zero(), uncertainty());
  const auto again = recognisePlace(now, before, Eigen::Vector3d::Zero(), uncertainty());
  ASSERT_TRUE(once && again);
  EXPECT_EQ(once->matches, again->matches);
}

} // namespace
} // namespace vi_ekf_slam::test
