#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "vi_ekf_slam/simulation/drive_simulator.hpp"

namespace vi_ekf_slam::simulation {
namespace {

/// Feature minus projection of the truth, px.
StereoPixels residual(const Drive& drive, const DriveStep& step, std::size_t i) {
  const Eigen::Vector3d p = drive.rig.cam_T_imu * (step.world_T_imu.inverse() * step.truth[i].world);
  return step.frame.features[i].pixels - drive.rig.camera.project(p);
}

template <class Visit> // visit(step, i)
void forEachObservation(const Drive& drive, ObservationKind kind, Visit visit) {
  for (const DriveStep& step : drive.steps) {
    for (std::size_t i = 0; i < step.truth.size(); ++i) {
      if (step.truth[i].kind == kind) visit(step, i);
    }
  }
}

Eigen::Matrix4d pixelCovariance(const Drive& drive, ObservationKind kind, double& n) {
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  n = 0.0;
  forEachObservation(drive, kind, [&](const DriveStep& step, std::size_t i) {
    const StereoPixels r = residual(drive, step, i);
    sum += r * r.transpose();
    n += 1.0;
  });
  return sum / n;
}

TEST(Features, StaticAndMovingOnesAreTheProjectedTruthPlusWhiteNoise) {
  const Drive drive = simulateDrive(DriveOptions());
  for (const ObservationKind kind : {ObservationKind::kStatic, ObservationKind::kMoving}) {
    double n = 0.0;
    const Eigen::Matrix4d covariance = pixelCovariance(drive, kind, n);
    ASSERT_GT(n, 1000.0);
    const double tolerance = 5.0 * 0.49 * std::sqrt(2.0 / n);
    EXPECT_LT((covariance - 0.49 * Eigen::Matrix4d::Identity()).cwiseAbs().maxCoeff(), tolerance)
        << covariance;
  }
}

TEST(Features, NoiseIsSharedByTheImagesAsTold) {
  DriveOptions options;
  options.pixel_correlation = 0.8;
  double n = 0.0;
  const Eigen::Matrix4d covariance = pixelCovariance(simulateDrive(options), ObservationKind::kStatic, n);
  EXPECT_NEAR(covariance(0, 0), 0.49, 0.02);
  EXPECT_NEAR(covariance(0, 2), 0.8 * 0.49, 0.02);
  EXPECT_NEAR(covariance(1, 3), 0.8 * 0.49, 0.02);
  EXPECT_NEAR(covariance(0, 1), 0.0, 0.02);
}

TEST(Features, WithoutNoiseTheyAreTheProjectionItself) {
  DriveOptions options;
  options.pixel_sigma = 0.0;
  const Drive drive = simulateDrive(options);
  double worst = 0.0;
  forEachObservation(drive, ObservationKind::kStatic, [&](const DriveStep& step, std::size_t i) {
    worst = std::max(worst, residual(drive, step, i).cwiseAbs().maxCoeff());
  });
  EXPECT_LT(worst, 1e-6);
}

TEST(Features, AStaticPointStaysWhereItIs) {
  const Drive drive = simulateDrive(DriveOptions());
  std::map<std::uint64_t, Eigen::Vector3d> points;
  forEachObservation(drive, ObservationKind::kStatic, [&](const DriveStep& step, std::size_t i) {
    ASSERT_EQ(points.emplace(step.truth[i].point, step.truth[i].world).first->second, step.truth[i].world);
  });
}

TEST(Features, OutliersAreFarFromTheTruth) {
  DriveOptions options;
  options.outlier_fraction = 0.3;
  const Drive drive = simulateDrive(options);
  double far = 0.0, n = 0.0;
  forEachObservation(drive, ObservationKind::kOutlier, [&](const DriveStep& step, std::size_t i) {
    far += residual(drive, step, i).norm() > 4.0 * options.pixel_sigma ? 1.0 : 0.0;
    n += 1.0;
  });
  ASSERT_GT(n, 1000.0);
  EXPECT_GT(far / n, 0.8);
}

TEST(Features, IdsAreUniqueAndOrderedWithinAFrame) {
  for (const DriveStep& step : simulateDrive(DriveOptions()).steps) {
    for (std::size_t i = 1; i < step.frame.features.size(); ++i) {
      ASSERT_LT(step.frame.features[i - 1].id, step.frame.features[i].id) << "frame " << step.index;
    }
  }
}

TEST(Features, LieInsideBothImagesAndTheDepthRange) {
  const Drive drive = simulateDrive(DriveOptions());
  forEachObservation(drive, ObservationKind::kStatic, [&](const DriveStep& step, std::size_t i) {
    const StereoPixels& z = step.frame.features[i].pixels;
    ASSERT_GT(z.minCoeff(), 0.0);
    ASSERT_LT(std::max(z[0], z[2]), 1226.0);
    ASSERT_LT(std::max(z[1], z[3]), 370.0);
    const double depth = (drive.rig.cam_T_imu * (step.world_T_imu.inverse() * step.truth[i].world)).z();
    ASSERT_GE(depth, drive.options.min_depth);
    ASSERT_LE(depth, drive.options.max_depth);
  });
}

class Rates : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Features, Rates, testing::Values(5.0, 10.0, 30.0));

DriveOptions atRate(double frame_rate) {
  DriveOptions options;
  options.frame_rate = frame_rate;
  return options;
}

TEST_P(Rates, NumbersResembleTheRealDrives) {
  const Drive drive = simulateDrive(atRate(GetParam()));
  std::vector<std::size_t> counts;
  std::map<FeatureId, int> lengths;
  for (const DriveStep& step : drive.steps) {
    counts.push_back(step.frame.features.size());
    for (const auto& feature : step.frame.features) ++lengths[feature.id];
  }
  std::vector<int> tracks;
  for (const auto& [id, length] : lengths) tracks.push_back(length);
  std::sort(counts.begin(), counts.end());
  std::sort(tracks.begin(), tracks.end());
  EXPECT_GE(counts.front(), 15u);
  EXPECT_NEAR(static_cast<double>(counts[counts.size() / 2]), 68.0, 12.0);
  EXPECT_LE(counts.back(), 130u);
  EXPECT_NEAR(tracks[tracks.size() / 2] / GetParam(), 1.1, 0.2); // s
  EXPECT_LE(tracks.back() / GetParam(), drive.options.track_max + 1e-9);
}

TEST_P(Rates, StaleFramesAreAsManyInASecond) {
  DriveOptions options = atRate(GetParam());
  options.features_max = 20;
  options.features_min = 5;
  options.laps = 10.0;
  double stale = 0.0, last = -1e9, least = 1e9; // s
  const Drive drive = simulateDrive(options);
  for (const DriveStep& step : drive.steps) {
    if (!step.stale) continue;
    const double now = static_cast<double>(step.index) / GetParam();
    least = std::min(least, now - last);
    last = now;
    stale += 1.0;
  }
  const double expected =
      10.0 * options.stale_fraction * static_cast<double>(drive.steps.size()) / GetParam();
  EXPECT_NEAR(stale, expected, 4.0 * std::sqrt(expected));
  EXPECT_GE(least, 0.3 - 1e-9);
}

/// How fast the outliers of `drive` that are not wrong in the right image alone leave their points, px/s.
std::vector<double> slideSpeeds(const Drive& drive) {
  std::map<FeatureId, std::pair<std::size_t, StereoPixels>> last;
  std::vector<double> speeds;
  forEachObservation(drive, ObservationKind::kOutlier, [&](const DriveStep& step, std::size_t i) {
    const StereoPixels off = residual(drive, step, i);
    const FeatureId id = step.frame.features[i].id;
    const auto old = last.find(id);
    if (std::abs(off[0] - off[2]) < 1e-6 && old != last.end() && old->second.first + 1 == step.index)
      speeds.push_back((off - old->second.second).head<2>().norm() * drive.options.frame_rate);
    last[id] = {step.index, off};
  });
  return speeds;
}

TEST_P(Rates, SlidingTracksSlideAsFarInASecond) {
  DriveOptions options = atRate(GetParam());
  options.outlier_fraction = 0.3;
  options.pixel_sigma = 0.0;
  const std::vector<double> speeds = slideSpeeds(simulateDrive(options));
  ASSERT_GT(speeds.size(), 200u);
  EXPECT_GE(*std::min_element(speeds.begin(), speeds.end()), 20.0 - 1e-6);
  EXPECT_LE(*std::max_element(speeds.begin(), speeds.end()), 50.0 + 1e-6);
}

TEST_P(Rates, TracksWalkByTheirDensityInBothImagesAlike) {
  DriveOptions options = atRate(GetParam());
  options.track_walk = 0.5;
  options.pixel_sigma = options.outlier_fraction = options.stale_fraction = 0.0;
  const Drive drive = simulateDrive(options);
  std::map<FeatureId, std::pair<std::size_t, Eigen::Vector2d>> born;
  double squares = 0.0, crossed = 0.0, n = 0.0, worst_new = 0.0, worst_split = 0.0;
  forEachObservation(drive, ObservationKind::kStatic, [&](const DriveStep& step, std::size_t i) {
    const StereoPixels off = residual(drive, step, i);
    worst_split = std::max(worst_split, (off.head<2>() - off.tail<2>()).norm());
    const auto birth = born.emplace(step.frame.features[i].id, std::make_pair(step.index, off.head<2>()));
    if (birth.second) worst_new = std::max(worst_new, off.norm());
    const double age = static_cast<double>(step.index - birth.first->second.first) / GetParam();
    if (age < 0.9 || age > 1.1) return; // s
    squares += 0.5 * off.head<2>().squaredNorm() / age;
    crossed += off[0] * off[1] / age;
    n += 1.0;
  });
  ASSERT_GT(n, 300.0);
  EXPECT_LT(worst_new, 1e-6);
  EXPECT_LT(worst_split, 1e-6);
  EXPECT_NEAR(squares / n, 0.25, 0.03);
  EXPECT_NEAR(crossed / n, 0.0, 0.03);
}

TEST(Features, OneTrackWalksWithoutTheOthers) {
  DriveOptions options;
  options.track_walk = 0.5;
  options.pixel_sigma = options.outlier_fraction = options.stale_fraction = 0.0;
  const Drive drive = simulateDrive(options);
  double together = 0.0, alone = 0.0;
  for (const DriveStep& step : drive.steps) {
    StereoPixels sum = StereoPixels::Zero();
    for (std::size_t i = 0; i < step.truth.size(); ++i) {
      sum += residual(drive, step, i);
      alone += residual(drive, step, i).squaredNorm();
    }
    together += sum.squaredNorm();
  }
  EXPECT_NEAR(together / alone, 1.0, 0.5); // some 68 if all walked as one
}

TEST(StaleFrames, RepeatEverySurvivorBitForBitAndNoOtherFrameDoes) {
  const Drive drive = simulateDrive(DriveOptions());
  double stale = 0.0;
  for (std::size_t k = 1; k < drive.steps.size(); ++k) {
    std::map<FeatureId, StereoPixels> before;
    for (const auto& feature : drive.steps[k - 1].frame.features) before[feature.id] = feature.pixels;
    const DriveStep& step = drive.steps[k];
    stale += step.stale ? 1.0 : 0.0;
    for (std::size_t i = 0; i < step.frame.features.size(); ++i) {
      const auto& feature = step.frame.features[i];
      const auto old = before.find(feature.id);
      if (old == before.end()) continue;
      ASSERT_EQ(old->second == feature.pixels, step.stale) << "frame " << k;
      ASSERT_EQ(step.truth[i].kind == ObservationKind::kStale, step.stale) << "frame " << k;
    }
  }
  const double n = static_cast<double>(drive.steps.size());
  EXPECT_NEAR(stale / n, drive.options.stale_fraction, 4.0 * std::sqrt(drive.options.stale_fraction / n));
}

TEST(StaleFrames, StartAnotherPointWhoseFirstObservationHasOrdinaryNoise) {
  const Drive drive = simulateDrive(DriveOptions());
  double n = 0.0;
  const Eigen::Matrix4d covariance = pixelCovariance(drive, ObservationKind::kStale, n);
  EXPECT_NEAR(covariance(0, 0), 0.49, 0.03);
  EXPECT_NEAR(covariance(2, 2), 0.49, 0.03);
  std::map<FeatureId, std::uint64_t> point;
  for (const DriveStep& step : drive.steps) {
    for (std::size_t i = 0; i < step.truth.size(); ++i) {
      const FeatureId id = step.frame.features[i].id;
      const auto old = point.find(id);
      if (old != point.end()) {
        ASSERT_EQ(old->second != step.truth[i].point, step.stale);
      }
      point[id] = step.truth[i].point;
    }
  }
}

TEST(StaleFrames, NoneWhenNotAskedFor) {
  DriveOptions options;
  options.stale_fraction = 0.0;
  for (const DriveStep& step : simulateDrive(options).steps) ASSERT_FALSE(step.stale);
}

/// How many ids are seen again after a gap, and how many of those at another point.
std::pair<int, int> returns(const DriveOptions& options) {
  std::map<FeatureId, std::pair<std::size_t, std::uint64_t>> last;
  int returned = 0, elsewhere = 0;
  for (const DriveStep& step : simulateDrive(options).steps) {
    for (std::size_t i = 0; i < step.truth.size(); ++i) {
      const FeatureId id = step.frame.features[i].id;
      const auto old = last.find(id);
      if (old != last.end() && old->second.first + 1 < step.index) {
        ++returned;
        elsewhere += old->second.second != step.truth[i].point ? 1 : 0;
      }
      last[id] = {step.index, step.truth[i].point};
    }
  }
  return {returned, elsewhere};
}

TEST(Ids, NeverReturnUnlessAskedTo) {
  DriveOptions options;
  EXPECT_EQ(returns(options).first, 0);
  options.ids_return = true;
  options.stale_fraction = 0.0;
  const auto [returned, elsewhere] = returns(options);
  EXPECT_GT(returned, 500);
  EXPECT_EQ(elsewhere, 0);
}

TEST(Corners, AreFoundAgainAsNearAsTold) {
  DriveOptions options;
  options.strength_spread = 3.0; // mostly the same ones
  options.ids_return = true;
  options.stale_fraction = options.outlier_fraction = 0.0;
  options.corner_sigma = 0.07;
  std::map<std::uint64_t, Eigen::Vector3d> last;
  double sum = 0.0, n = 0.0;
  forEachObservation(
      simulateDrive(options), ObservationKind::kStatic, [&](const DriveStep& step, std::size_t i) {
        const auto [known, is_new] = last.try_emplace(step.truth[i].point, step.truth[i].world);
        if (is_new || known->second == step.truth[i].world) return;
        sum += (step.truth[i].world - known->second).squaredNorm();
        n += 3.0;
        known->second = step.truth[i].world;
      });
  ASSERT_GT(n, 300.0);
  const double variance = 2.0 * 0.07 * 0.07;
  EXPECT_NEAR(sum / n, variance, 5.0 * variance * std::sqrt(2.0 / n));
}

TEST(MovingObjects, MoveTogether) {
  DriveOptions options;
  options.stale_fraction = 0.0;
  const Drive drive = simulateDrive(options);
  std::map<std::uint64_t, std::pair<std::size_t, Eigen::Vector3d>> last;
  int moved = 0;
  forEachObservation(drive, ObservationKind::kMoving, [&](const DriveStep& step, std::size_t i) {
    const auto old = last.find(step.truth[i].point);
    if (old != last.end() && old->second.first + 1 == step.index) {
      const double speed = (step.truth[i].world - old->second.second).norm() / 0.1;
      ASSERT_GT(speed, 2.0);
      ASSERT_LT(speed, 15.0);
      ++moved;
    }
    last[step.truth[i].point] = {step.index, step.truth[i].world};
  });
  EXPECT_GT(moved, 500);
  options.moving_objects = 0;
  forEachObservation(simulateDrive(options), ObservationKind::kMoving, [](const DriveStep&, std::size_t) {
    FAIL() << "a moving point without moving objects";
  });
}

bool same(const Drive& a, const Drive& b) {
  if (a.steps.size() != b.steps.size()) return false;
  for (std::size_t k = 0; k < a.steps.size(); ++k) {
    const DriveStep &x = a.steps[k], &y = b.steps[k];
    if (x.frame.features.size() != y.frame.features.size()) return false;
    if (x.gyro[0].angular_velocity != y.gyro[0].angular_velocity) return false;
    for (std::size_t i = 0; i < x.frame.features.size(); ++i) {
      if (x.frame.features[i].id != y.frame.features[i].id) return false;
      if (x.frame.features[i].pixels != y.frame.features[i].pixels) return false;
    }
  }
  return true;
}

TEST(Determinism, TheSeedDecidesTheDrive) {
  for (const MotionModel motion : {MotionModel::kCarDrive, MotionModel::kProcessModel}) {
    DriveOptions options;
    options.motion = motion;
    options.duration = 40.0;
    const Drive drive = simulateDrive(options);
    EXPECT_TRUE(same(drive, simulateDrive(options)));
    options.seed = 2;
    EXPECT_FALSE(same(drive, simulateDrive(options)));
  }
}

TEST(Determinism, SensorNoiseDoesNotMoveTheCar) {
  DriveOptions options;
  options.motion = MotionModel::kProcessModel;
  options.duration = 10.0;
  const Drive drive = simulateDrive(options);
  options.gyro_sigma = 0.0;
  options.pixel_sigma = 0.1;
  const Drive quiet = simulateDrive(options);
  EXPECT_EQ(drive.steps.back().world_T_imu.matrix(), quiet.steps.back().world_T_imu.matrix());
}

TEST(Measurements, ComeInTheOrderOfTheirStampsAndStreams) {
  DriveOptions options;
  options.imu_rate = 50.0;
  const std::vector<Measurement> measurements = measurementsOf(*DriveSimulator(options).next());
  ASSERT_EQ(measurements.size(), 11u);
  EXPECT_EQ(streamOf(measurements[2]), Stream::kStereo);
  for (std::size_t i = 1; i < measurements.size(); ++i) {
    const auto key = [&](std::size_t j) {
      return std::make_pair(stampOf(measurements[j]), streamOf(measurements[j]));
    };
    EXPECT_LT(key(i - 1), key(i));
  }
}

} // namespace
} // namespace vi_ekf_slam::simulation
