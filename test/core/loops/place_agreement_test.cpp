#include <gtest/gtest.h>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/loops/place_recogniser.hpp"

namespace vi_ekf_slam::test {
namespace {

/// Shifted by `x` m, with ten matches from number `first` on.
Recognition place(double x, FeatureId first) {
  Recognition recognition{SE3(Eigen::Matrix3d::Identity(), {x, 0.0, 0.0}), {}};
  for (FeatureId id = first; id < first + 10; ++id) recognition.matches.emplace_back(id, 1000 + id);
  return recognition;
}

const Eigen::Vector3d kHere = Eigen::Vector3d::Zero(), kFartherOn(6.0, 0.0, 0.0);

TEST(PlaceAgreement, WantsAnotherAttemptByOtherPointsFromElsewhere) {
  PlaceAgreement agreement(2, 10);
  EXPECT_FALSE(agreement.confirms(place(2.0, 0), kHere, 5.0));
  EXPECT_FALSE(agreement.confirms(place(2.0, 10), kHere, 5.0));     // from the same place
  EXPECT_FALSE(agreement.confirms(place(2.0, 5), kFartherOn, 5.0)); // by the same points
  EXPECT_TRUE(agreement.confirms(place(2.3, 10), kFartherOn, 5.0));
  EXPECT_TRUE(agreement.confirms(place(2.3, 20), kFartherOn, 5.0)); // as often as it is asked
  agreement.restart();
  EXPECT_FALSE(agreement.confirms(place(2.3, 20), kFartherOn, 5.0));
}

TEST(PlaceAgreement, WantsAsManyAttemptsAsItIsToldTo) {
  PlaceAgreement agreement(3, 5);
  EXPECT_FALSE(agreement.confirms(place(2.0, 0), kHere, 5.0));
  EXPECT_FALSE(agreement.confirms(place(2.0, 10), kFartherOn, 5.0));
  EXPECT_TRUE(agreement.confirms(place(2.0, 10), kFartherOn, 5.0));
}

TEST(PlaceAgreement, BeginsAnewWithOneThatDisagrees) {
  PlaceAgreement agreement(2, 10);
  EXPECT_FALSE(agreement.confirms(place(2.0, 0), kHere, 5.0));
  EXPECT_FALSE(agreement.confirms(place(4.0, 10), kFartherOn, 5.0)); // another shift
  Recognition turned = place(4.0, 20);
  turned.before_T_now = SE3(so3::Exp({0.0, 0.0, 0.1}), {4.0, 0.0, 0.0});
  EXPECT_FALSE(agreement.confirms(turned, 2.0 * kFartherOn, 5.0)); // another turn
  agreement.restart();
  EXPECT_FALSE(agreement.confirms(turned, 3.0 * kFartherOn, 5.0));
}

} // namespace
} // namespace vi_ekf_slam::test
