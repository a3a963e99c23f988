#include "vi_ekf_slam/core/map/saved_map.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "../numeric.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

SavedMap example() {
  test::Random random(1);
  SavedMap map;
  map.stamp = fromSeconds(1000.5);
  map.world_T_imu = SE3::Exp(random.vector<6>(-1.0, 1.0));
  map.variables = {{"twist", random.vector<6>(-1.0, 1.0)}, {"twist_bias", random.vector<6>(-0.1, 0.1)}};
  for (FeatureId id = 1; id <= 4; ++id) map.landmarks.push_back({id, random.vector<3>(-9.0, 9.0), 12});
  map.covariance = random.covariance<30>();
  return map;
}

TEST(SavedMap, AnHonestOneIsValid) {
  EXPECT_NO_THROW(validate(example(), "FILE"));
  SavedMap empty = example();
  empty.landmarks.clear();
  empty.covariance = Eigen::MatrixXd::Zero(18, 18);
  EXPECT_NO_THROW(validate(empty, "FILE")) << "known exactly";
  empty.variables.clear();
  empty.covariance = Eigen::MatrixXd::Zero(6, 6);
  EXPECT_NO_THROW(validate(empty, "FILE")) << "a pose alone";
}

TEST(SavedMap, WhatIsWrongIsNamedWithItsValueAndWhatIsAllowed) {
  struct Case {
    std::function<void(SavedMap&)> spoil;
    const char *field, *value;
  };
  const std::vector<Case> cases = {
      {[](SavedMap& m) { m.stamp = 0; }, "stamp", "0"},
      {[](SavedMap& m) { m.stamp = fromSeconds(4.3e9); }, "stamp", "4300000000"},
      {[](SavedMap& m) {
         m.world_T_imu = {Eigen::Matrix3d::Identity(), {0.0, kNaN, 0.0}};
       },
       "pose.position[1]", "nan"},
      {[](SavedMap& m) {
         m.world_T_imu = {Eigen::Matrix3d::Identity(), {1e308, 0.0, 0.0}};
       },
       "pose.position[0]", "1e+308"},
      {[](SavedMap& m) {
         m.world_T_imu = {1.1 * Eigen::Matrix3d::Identity(), {0.0, 0.0, 0.0}};
       },
       "pose.orientation", "no rotation"},
      {[](SavedMap& m) { m.variables[0].mean[2] = -1e4; }, "twist[2]", "-10000"},
      {[](SavedMap& m) { m.variables[1].mean[5] = std::numeric_limits<double>::infinity(); }, "twist_bias[5]",
       "inf"},
      {[](SavedMap& m) { m.variables[1].name = "twist"; }, "variables[1].name", "twist"},
      {[](SavedMap& m) { m.variables[1].name.clear(); }, "variables[1].name", "of 0 characters"},
      {[](SavedMap& m) { m.variables[1].name.assign(33, 'x'); }, "variables[1].name", "of 33 characters"},
      {[](SavedMap& m) { m.variables[0].name = "twist\n"; }, "variables[0].name", "of a to z"},
      {[](SavedMap& m) { m.variables[0].mean.resize(0); }, "variables[0].mean", "of 0 numbers"},
      {[](SavedMap& m) { m.variables[0].mean.setZero(33); }, "variables[0].mean", "of 33 numbers"},
      {[](SavedMap& m) { m.variables[0].mean.setZero(5); }, "covariance", "29 x 29"},
      {[](SavedMap& m) {
         for (int i = 0; i < 15; ++i)
           m.variables.push_back({"v" + std::to_string(i), Eigen::VectorXd::Zero(1)});
       },
       "variables", "17"},
      {[](SavedMap& m) { m.landmarks[3].id = 1; }, "landmarks[3].id", "1"},
      {[](SavedMap& m) { m.landmarks[2].position.z() = 2e6; }, "landmarks[2].position[2]", "2000000"},
      {[](SavedMap& m) { m.landmarks.pop_back(); }, "covariance", "30 x 30"},
      {[](SavedMap& m) { m.landmarks.resize(kMaxSavedLandmarks + 1); }, "landmarks", "4001"},
      {[](SavedMap& m) { m.covariance(20, 20) = -1e-3; }, "covariance[20][20]", "-0.001"},
      {[](SavedMap& m) { m.covariance(3, 3) = kNaN; }, "covariance[3][3]", "nan"},
      {[](SavedMap& m) { m.covariance(3, 3) = 1e308; }, "covariance[3][3]", "1e+308"},
      {[](SavedMap& m) { m.covariance(7, 2) = m.covariance(2, 7) = kNaN; }, "covariance[7][2]", "nan"},
      {[](SavedMap& m) { m.covariance(7, 2) += 1e-3; }, "covariance[2][7]", "symmetry"},
      {[](SavedMap& m) { m.covariance(7, 2) = m.covariance(2, 7) = 1e3; }, "covariance[7][2]", "1000"},
      {[](SavedMap& m) {
         m.covariance = Eigen::MatrixXd::Identity(30, 30);
         // Each pair is possible, the three together are not: eigenvalue 1 - 2 * 0.7.
         for (const auto& [i, j] : {std::pair{1, 8}, std::pair{1, 25}, std::pair{8, 25}})
           m.covariance(i, j) = m.covariance(j, i) = -0.7;
       },
       "covariance", "not positive semidefinite"},
  };
  for (const Case& c : cases) {
    SavedMap map = example();
    c.spoil(map);
    try {
      validate(map, "FILE");
      ADD_FAILURE() << c.field << " " << c.value << " is accepted";
    } catch (const MapError& e) {
      const std::string what = e.what();
      EXPECT_EQ(what.rfind("FILE: ", 0), 0U) << what;
      for (const char* part : {c.field, c.value, "allowed: "})
        EXPECT_NE(what.find(part), std::string::npos) << what << " lacks " << part;
    }
  }
}

} // namespace
} // namespace vi_ekf_slam
