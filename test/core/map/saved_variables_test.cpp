// A saved map is known by the names of its variables: another estimator takes of it what it has itself.

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <string>

#include "../road.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

/// The baseline's scale is a variable, and so is what tracks slip by.
InvariantConfig withScaleAndSlip() {
  InvariantConfig config;
  config.rig.scale_sigma = 0.01;
  return config;
}

SavedMap savedFrom(const Estimator& estimator) { return estimator.savedMap()(); }

SavedMap drivenMap(const InvariantConfig& config = withScaleAndSlip()) {
  Road road(1, 40, kTypical);
  return savedFrom(driven(road, 60, config));
}

/// What an estimator of this configuration, resumed at once, saves.
SavedMap resumed(const SavedMap& map, const InvariantConfig& config) {
  InvariantEstimator estimator = withRig(config);
  estimator.resumeFrom(std::make_shared<const SavedMap>(map), "map", 30.0);
  estimator.process(StereoFrame{map.stamp, {}});
  EXPECT_EQ(estimator.mapUse(), MapUse::kResumed);
  return savedFrom(estimator);
}

std::vector<std::string> namesOf(const SavedMap& map) {
  std::vector<std::string> names;
  for (const SavedVariable& variable : map.variables) names.push_back(variable.name);
  return names;
}

/// The map with these of its variables, in this order; others are marginalised.
SavedMap with(const SavedMap& map, const std::vector<std::string>& names) {
  SavedMap result = map;
  result.variables.clear();
  std::vector<Eigen::Index> rows(6);
  std::iota(rows.begin(), rows.end(), 0);
  for (const std::string& name : names) {
    Eigen::Index row = 6;
    for (const SavedVariable& variable : map.variables) {
      for (Eigen::Index i = 0; variable.name == name && i < variable.mean.size(); ++i)
        rows.push_back(row + i);
      if (variable.name == name) result.variables.push_back(variable);
      row += variable.mean.size();
    }
  }
  for (Eigen::Index row = map.base(); row < map.covariance.rows(); ++row) rows.push_back(row);
  const auto n = static_cast<Eigen::Index>(rows.size());
  result.covariance.resize(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j)
      result.covariance(i, j) =
          map.covariance(rows[static_cast<std::size_t>(i)], rows[static_cast<std::size_t>(j)]);
  }
  return result;
}

/// But for what is added to allow for rounding: 1e-12 of the largest variance, landmarks being up to 100 m
/// away.
void expectSameKnowledge(const SavedMap& actual, const SavedMap& expected) {
  ASSERT_EQ(namesOf(actual), namesOf(expected));
  ASSERT_EQ(actual.landmarks.size(), expected.landmarks.size());
  for (std::size_t i = 0; i < expected.variables.size(); ++i)
    EXPECT_EQ(actual.variables[i].mean, expected.variables[i].mean) << expected.variables[i].name;
  const auto variances = expected.covariance.diagonal();
  const double largest = variances.maxCoeff() + 1e4 * variances.segment<3>(3).maxCoeff();
  EXPECT_LT((actual.covariance - expected.covariance).cwiseAbs().maxCoeff(), 2e-12 * largest);
}

TEST(SavedVariables, AreAllThatTheCoreHasWithTheirCovariance) {
  const SavedMap map = drivenMap();
  EXPECT_NO_THROW(validate(map, "map"));
  EXPECT_EQ(namesOf(map), (std::vector<std::string>{"twist", "twist_bias", "scale", "slip", "given_rig"}));
  EXPECT_EQ(map.base(), 36);
  EXPECT_NE(map.variables[2].mean[0], 0.0);
  EXPECT_GT(map.covariance.block(18, 36, 5, map.covariance.cols() - 36).cwiseAbs().maxCoeff(), 0.0)
      << "correlated with landmarks";
  expectSameKnowledge(resumed(map, withScaleAndSlip()), map);
}

TEST(SavedVariables, AreKnownByNameInWhateverOrderTheyAre) {
  const SavedMap map = drivenMap();
  const SavedMap other = with(map, {"slip", "given_rig", "twist_bias", "twist", "scale"});
  EXPECT_NO_THROW(validate(other, "map"));
  expectSameKnowledge(resumed(other, withScaleAndSlip()), map);
}

TEST(SavedVariables, AreMarginalisedWhereTheEstimatorLacksThem) {
  const SavedMap map = drivenMap();
  expectSameKnowledge(resumed(map, steadyTracks()), with(map, {"twist", "twist_bias"}));
  SavedMap other = map;
  other.variables[2].name = "elsewhere";
  const SavedMap again = resumed(other, withScaleAndSlip());
  EXPECT_EQ(again.variables[2].name, "scale");
  EXPECT_EQ(again.variables[2].mean[0], 0.0);
}

TEST(SavedVariables, KeepTheirPriorsWhereTheMapLacksThem) {
  const SavedMap map = drivenMap(steadyTracks());
  const InvariantConfig config = withScaleAndSlip();
  const SavedMap again = resumed(map, config);
  expectSameKnowledge(with(again, {"twist", "twist_bias"}), map);
  EXPECT_EQ(again.variables[2].mean[0], 0.0);
  EXPECT_NEAR(again.covariance(18, 18), config.rig.scale_sigma * config.rig.scale_sigma, 1e-18);
  EXPECT_NEAR(again.covariance(19, 19), config.slip.sigma * config.slip.sigma, 1e-18);
  Eigen::MatrixXd others = again.covariance.middleRows(18, 5);
  others.middleCols(18, 5).setZero();
  EXPECT_EQ(others.cwiseAbs().maxCoeff(), 0.0) << "uncorrelated";
}

InvariantConfig withRigUnsure() {
  InvariantConfig config = withScaleAndSlip();
  config.rig.rotation_sigma.setConstant(0.02);
  config.rig.translation_sigma.setConstant(0.02);
  return config;
}

/// What an estimator that is told `rig` knows of it where it has resumed from `map`.
RigEstimate resumedOn(const SavedMap& map, const StereoRig& rig, bool is_late = false) {
  InvariantEstimator estimator(withRigUnsure());
  if (!is_late) estimator.setRig(rig);
  estimator.resumeFrom(std::make_shared<const SavedMap>(map), "map", 30.0);
  EXPECT_TRUE(estimator.resumeAt(map.stamp));
  if (is_late) estimator.setRig(rig);
  return *estimator.rig();
}

double rigDistance(const StereoRig& a, const StereoRig& b) {
  return distance(a.cam_T_imu.matrix(), b.cam_T_imu.matrix()) +
         std::abs(a.camera.baseline - b.camera.baseline);
}

// calibration/file holds what a run has found already: it counts once.
TEST(SavedVariables, CorrectTheRigAlone) {
  Road road(1, 40, kTypical);
  const InvariantEstimator estimator = driven(road, 60, withRigUnsure());
  const RigEstimate found = *estimator.rig();
  const SavedMap map = savedFrom(estimator);
  ASSERT_GT(rigDistance(found.rig, exampleRig()), 1e-3);
  const RigEstimate same = resumedOn(map, exampleRig());
  EXPECT_LT(rigDistance(same.rig, found.rig), 1e-9);
  EXPECT_LT(same.baseline_sigma, 1.001 * found.baseline_sigma);
  const SavedMap of_earlier_version =
      with(map, {"twist", "twist_bias", "camera_rotation", "camera_translation", "scale", "slip"});
  struct Case {
    const SavedMap& map;
    StereoRig told;
    bool is_late;
  };
  for (const Case& c : {Case{map, found.rig, false}, Case{of_earlier_version, exampleRig(), false},
                        Case{map, found.rig, true}}) {
    const RigEstimate now = resumedOn(c.map, c.told, c.is_late);
    EXPECT_LT(rigDistance(now.rig, c.told), 1e-9);
    EXPECT_NEAR(now.rotation_sigma[0], 0.02, 1e-9) << "as it was given beforehand";
    EXPECT_NEAR(now.baseline_sigma, 0.01 * c.told.camera.baseline, 1e-9);
  }
}

TEST(SavedVariables, OfAnotherRigAreNamed) {
  Road road(1, 40, kTypical);
  const InvariantEstimator estimator = driven(road, 60, withRigUnsure());
  const auto map = std::make_shared<const SavedMap>(savedFrom(estimator));
  for (const StereoRig& told : {exampleRig(), estimator.rig()->rig}) {
    Config config;
    config.invariant = withRigUnsure();
    SlamSystem system(config);
    std::string said;
    system.onStart([&said](const std::string& text) { said += text; });
    system.resumeFrom(map, "map");
    system.setRig(told);
    const bool is_other = rigDistance(told, exampleRig()) > 0.0;
    EXPECT_EQ(said.find("the calibration begins as it is given") != said.npos, is_other) << said;
  }
}

TEST(SavedVariables, OfTheMotionModelAreNeededToGoOn) {
  const SavedMap map = drivenMap();
  SavedMap of_another_size = map;
  of_another_size.variables[1].mean.conservativeResize(3);
  for (const SavedMap& other : {with(map, {"twist", "scale", "slip"}), of_another_size}) {
    InvariantEstimator estimator = withRig();
    try {
      estimator.resumeFrom(std::make_shared<const SavedMap>(other), "FILE", 30.0);
      ADD_FAILURE() << "resumed";
    } catch (const MapError& e) {
      EXPECT_EQ(std::string(e.what()).rfind("FILE: variable twist_bias is missing", 0), 0U) << e.what();
    }
    EXPECT_EQ(estimator.mapUse(), MapUse::kNone);
  }
}

TEST(SavedVariables, AreNotNeededToFindAPlace) {
  Road road(6, 40, kTypical);
  const SavedMap map = savedFrom(driven(road, 60, withScaleAndSlip()));
  InvariantEstimator with_all = withRig(), with_none = withRig();
  with_all.relocaliseIn(std::make_shared<const SavedMap>(map));
  with_none.relocaliseIn(std::make_shared<const SavedMap>(with(map, {})));
  for (int i = 0; i < 30; ++i) {
    Road same = road;
    same.feed(with_all);
    road.feed(with_none);
  }
  EXPECT_EQ(with_none.mapUse(), MapUse::kRelocalised);
  expectSame(with_none.state(), with_all.state(), 1e-6);
}

} // namespace
} // namespace vi_ekf_slam
