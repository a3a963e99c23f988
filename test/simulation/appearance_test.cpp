/// Places recognised by what landmarks look like, on drives of two laps round a block.

#include "vi_ekf_slam/simulation/appearance.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "../sanitized.hpp"
#include "vi_ekf_slam/core/map/descriptor_set.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr std::size_t kSeeds = kSanitized ? 1 : 4;

std::vector<SeedResult> drive(DriveOptions options, PlaceRecognition recognition,
                              std::size_t seeds = kSeeds) {
  options.descriptors = true;
  options.strength_spread = 3.0;
  options.features_max = 75;   // a closure costs their cube
  options.corner_sigma = 0.07; // two tracks of a corner are 0.1 m apart then, as the filter has it
  Config config;
  // The truth about its tracks: they do not slip, and their noise is white.
  config.invariant.slip.sigma = 0.0;
  config.invariant.stereo.pixel_sigma = options.pixel_sigma;
  config.invariant.recognise_places = recognition;
  return runSeeds(config, options, 1, seeds, 1);
}

double finalRms(const std::vector<SeedResult>& results) {
  double sum = 0.0;
  for (const SeedResult& result : results) sum += std::pow(result.frames.back().position, 2);
  return std::sqrt(sum / static_cast<double>(results.size()));
}

TEST(PlacesByLooks, CloseLoopsWithAnHonestCovariance) {
  const auto with = drive(studyOptions(MotionModel::kCarDrive), PlaceRecognition::kDescriptors);
  const auto without = drive(studyOptions(MotionModel::kCarDrive), PlaceRecognition::kNone);
  double nees = 0.0;
  for (const SeedResult& result : with) {
    EXPECT_GT(result.places, 0u) << result.seed;
    EXPECT_EQ(result.wrong_places, 0u) << result.seed;
    nees += result.frames.back().nees.pose / static_cast<double>(with.size());
  }
  std::printf("final position %.3f m (RMS), without loops %.3f m; pose NEES at the end %.2f\n",
              finalRms(with), finalRms(without), nees);
  EXPECT_LT(3.0 * finalRms(with), finalRms(without));
  EXPECT_LT(nees, chiSquareMeanBounds(6, static_cast<double>(kSeeds)).second);
}

TEST(PlacesByLooks, AreNotMistakenInStreetsThatRepeatThemselves) {
  DriveOptions options = studyOptions(MotionModel::kCarDrive);
  options.alike_streets = true;
  options.block_width = 40.0;
  options.gyro_sigma = 0.1; // to be less sure of where it is
  options.laps = 1.3;
  for (const SeedResult& result : drive(options, PlaceRecognition::kDescriptors))
    EXPECT_EQ(result.wrong_places, 0u) << result.seed;
}

TEST(PlacesByLooks, RepeatThemselves) {
  DriveOptions options = studyOptions(MotionModel::kCarDrive);
  options.laps = 1.2;
  const auto once = drive(options, PlaceRecognition::kDescriptors, 1),
             again = drive(options, PlaceRecognition::kDescriptors, 1);
  EXPECT_GT(once.front().places, 0u);
  EXPECT_EQ(once.front().frames.back().position, again.front().frames.back().position);
  EXPECT_EQ(once.front().places, again.front().places);
}

TEST(Appearance, ChangesWithTheViewAndNotWithTheChanceOfTheDraw) {
  DriveOptions options;
  options.descriptors = true;
  options.alike_share = 0.0;
  Appearance appearance(options);
  const auto mean = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, std::uint64_t other) {
    double bits = 0.0;
    for (std::uint64_t look = 0; look < 200; ++look)
      bits += hammingDistance(appearance.describe(look, a), appearance.describe(look + other, b)) / 200.0;
    return bits;
  };
  const Eigen::Vector3d ahead(15.0, 0.0, 0.0), turned(15.0 * std::cos(0.52), 15.0 * std::sin(0.52), 0.0);
  EXPECT_NEAR(mean(ahead, ahead, 0), 15.5, 2.0); // noise alone
  EXPECT_NEAR(mean(ahead, turned, 0), 30.0 + 15.5, 12.0);
  EXPECT_GT(mean(ahead, -ahead, 0), 80.0);
  EXPECT_NEAR(mean(ahead, ahead, 1000), 128.0, 4.0);
}

TEST(Appearance, IsThatOfAFewKindsForAShare) {
  DriveOptions options;
  options.descriptors = true;
  options.alike_share = 0.2;
  Appearance appearance(options);
  const Eigen::Vector3d ahead(15.0, 0.0, 0.0);
  std::vector<Descriptor> looks;
  for (std::uint64_t look = 0; look < 400; ++look) looks.push_back(appearance.describe(look, ahead));
  int with_twin = 0;
  for (std::size_t i = 0; i < looks.size(); ++i) {
    bool twin = false;
    for (std::size_t j = 0; j < looks.size() && !twin; ++j)
      twin = i != j && hammingDistance(looks[i], looks[j]) < 50;
    with_twin += twin ? 1 : 0;
  }
  EXPECT_NEAR(with_twin, 80, 25);
}

} // namespace
} // namespace vi_ekf_slam::simulation
