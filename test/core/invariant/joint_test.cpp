// The joint covariance as a whole, against dense algebra.

#include <numeric>

#include "dense_drive.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

/// What the dense filter says about the errors along the world axes, inactive landmarks before active ones,
/// by id.
struct Expected {
  std::vector<Landmark> landmarks;
  Eigen::MatrixXd covariance;
};

Expected expectedJoint(const DenseJoint& dense, const std::vector<Landmark>& order) {
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(State::offsetOf(order.size()), dense.P.rows());
  J.topLeftCorner<kLandmarks, kLandmarks>().setIdentity();
  J.block<3, 3>(kPosition, kRotation) = -so3::hat(dense.pose.translation());
  Expected expected;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Eigen::Index row = State::offsetOf(i);
    for (std::size_t j = 0; j < dense.active.size(); ++j) {
      if (dense.active[j].id != order[i].id) continue;
      J.block<3, 3>(row, dense.offset(j)).setIdentity();
      J.block<3, 3>(row, kRotation) = -so3::hat(dense.active[j].position);
      expected.landmarks.push_back(dense.active[j]);
    }
    for (std::size_t j = 0; j < dense.inactive.size(); ++j) {
      if (dense.inactive[j].id != order[i].id) continue;
      J.block<3, 3>(row, dense.inactiveOffset(j)).setIdentity();
      expected.landmarks.push_back(dense.inactive[j]);
    }
  }
  expected.covariance = J * dense.P * J.transpose();
  return expected;
}

void expectJoint(const State::Joint& joint, const Expected& expected) {
  ASSERT_EQ(joint.landmarks.size(), expected.landmarks.size());
  for (std::size_t i = 0; i < joint.landmarks.size(); ++i) {
    EXPECT_EQ(joint.landmarks[i].id, expected.landmarks[i].id);
    EXPECT_EQ(joint.landmarks[i].observations, expected.landmarks[i].observations);
    EXPECT_LT(distance(joint.landmarks[i].position, expected.landmarks[i].position), 1e-8);
  }
  EXPECT_EQ(distance(joint.covariance, joint.covariance.transpose()), 0.0);
  EXPECT_LT(worstCorrelationError(joint.covariance, expected.covariance), 1e-9);
}

TEST(Joint, EqualsTheDenseJointCovarianceAlongTheWorldAxes) {
  Twins twins(21);
  for (int frame = 1; frame <= 60; ++frame) {
    twins.step();
    if (frame % 7 == 0) twins.activateSome(2);
    if (frame % 20 != 0) continue;
    State copy = twins.state();
    const State::Joint joint = copy.joint({1, 0, 4});
    ASSERT_EQ(joint.landmarks.size(), twins.dense().inactive.size() + 3);
    const std::size_t chosen[] = {1, 0, 4};
    for (std::size_t i = 0; i < 3; ++i)
      EXPECT_EQ(joint.landmarks[twins.dense().inactive.size() + i].id, copy.landmarks()[chosen[i]].id);
    expectJoint(joint, expectedJoint(twins.dense(), joint.landmarks));
  }
}

TEST(Joint, IsRestoredAsItWasAndCorrectedAlike) {
  Twins twins(22);
  for (int frame = 1; frame <= 40; ++frame) twins.step();
  State original = twins.state();
  std::vector<std::size_t> all(original.landmarks().size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  const State::Joint before = original.joint(all);
  State restored(kPrior, true);
  restored.addLandmark(1, {1.0, 2.0, 3.0}, Eigen::Matrix3d::Identity());
  restored.restore(original.pose(), original.twist(), original.bias(), before);
  EXPECT_TRUE(restored.landmarks().empty());
  const State::Joint after = State(restored).joint({});
  EXPECT_LT(worstCorrelationError(after.covariance, before.covariance), 1e-9);

  const auto correct = [](State& state, const Eigen::Vector3d& innovation) {
    const Eigen::MatrixXd H = twistRows(state, 3);
    const Update update = updateOf(state, H, 1e-4 * Eigen::Matrix3d::Identity());
    SparseRows rows(3);
    rows.add(0, kTwist + 3, Eigen::Matrix3d::Identity());
    rows.add(0, kBias + 3, Eigen::Matrix3d::Identity());
    ASSERT_TRUE(state.apply(Correction(update.PHt, update.S, innovation, rows)));
  };
  for (State* state : {&original, &restored}) {
    correct(*state, Eigen::Vector3d::Zero());
    state->propagate(0.1, kNoise);
  }
  EXPECT_LT(worstCorrelationError(restored.joint({}).covariance, original.joint(all).covariance), 1e-9);

  for (State* state : {&original, &restored}) correct(*state, Eigen::Vector3d(2e-3, -1e-3, 1e-3));
  EXPECT_LT(distance(original.pose().matrix(), restored.pose().matrix()), 1e-12);
  const State::Joint a = original.joint(all), b = restored.joint({});
  double moved = 0.0;
  for (std::size_t i = 0; i < a.landmarks.size(); ++i) {
    // A mean follows e where it is active and d where it is not: the same to first order in the correction.
    moved = std::max(moved, distance(a.landmarks[i].position, before.landmarks[i].position));
    EXPECT_LT(distance(a.landmarks[i].position, b.landmarks[i].position), 1e-6);
  }
  EXPECT_GT(moved, 1e-4) << "the correction is one";
}

TEST(Joint, AdoptedLandmarksCorrectAsTheDenseFilterHasIt) {
  Random random(23);
  Twins twins(23);
  for (int frame = 0; frame < 5; ++frame) twins.step();
  State state = twins.state();
  DenseJoint dense = twins.dense();
  while (!dense.inactive.empty()) dense.removeInactive(0);
  const Eigen::MatrixXd A = randomMatrix(random, 15, 15);
  const Eigen::MatrixXd covariance = A * A.transpose() + 0.1 * Eigen::MatrixXd::Identity(15, 15);
  std::vector<Landmark> landmarks;
  for (FeatureId id = 0; id < 5; ++id)
    landmarks.push_back({1000 + id, random.vector<3>(-20.0, 20.0), 7 + id});
  state.adopt(landmarks, covariance);
  dense.inactive = landmarks;
  Eigen::MatrixXd P = Eigen::MatrixXd::Zero(dense.P.rows() + 15, dense.P.rows() + 15);
  P.topLeftCorner(dense.P.rows(), dense.P.rows()) = dense.P;
  P.bottomRightCorner(15, 15) = covariance;
  dense.P = P;
  EXPECT_GT(state.inactive().departuresSince(1000), 1000000U);

  state.activateLandmarks({1003, 1001});
  dense.activate(1003);
  dense.activate(1001);
  const std::size_t last = state.landmarks().size() - 1;
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(3, dense.P.rows());
  H.block<3, 3>(0, State::offsetOf(0)).setIdentity();
  H.block<3, 3>(0, State::offsetOf(last)) = -Eigen::Matrix3d::Identity();
  SparseRows rows(3);
  rows.add(0, State::offsetOf(0), Eigen::Matrix3d::Identity());
  rows.add(0, State::offsetOf(last), -Eigen::Matrix3d::Identity());
  const Eigen::Matrix3d R = 0.01 * Eigen::Matrix3d::Identity();
  const Update update = updateOf(state, H.leftCols(state.size()), R);
  ASSERT_TRUE(state.apply(Correction(update.PHt, update.S, Eigen::Vector3d(0.3, 0.2, -0.1), rows)));
  dense.update(H, R, Eigen::Vector3d(0.3, 0.2, -0.1), nullptr);
  const State::Joint joint = state.joint({last, 2});
  expectJoint(joint, expectedJoint(dense, joint.landmarks));
  EXPECT_THROW(state.adopt({landmarks[0], landmarks[0]}, Eigen::MatrixXd::Identity(6, 6)), std::logic_error);
}

// Along the world axes what is anchored or out of view stays where it is, and pose and tracked landmarks turn
// and shift as one.
TEST(Joint, IsLoosenedPastWhatIsAnchoredOrOutOfView) {
  Random random(24);
  Twins twins(24);
  for (int frame = 1; frame <= 30; ++frame) twins.step();
  twins.activateSome(3);
  State state = twins.state();
  std::vector<std::size_t> active(state.landmarks().size());
  std::iota(active.begin(), active.end(), std::size_t{0});
  const auto jointOf = [&active](State copy) { return copy.joint(active); };
  const State::Joint before = jointOf(state);
  const Matrix6d noise = 1e-2 * random.covariance<6>();
  state.loosen(noise);
  const State::Joint after = jointOf(state);

  const std::size_t inactive = before.landmarks.size() - active.size();
  ASSERT_GT(inactive, 5u);
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(before.covariance.rows(), 6);
  G.topRows<6>().setIdentity();
  G.block<3, 3>(kPosition, 3) = -so3::hat(state.pose().translation());
  std::size_t anchored = 0;
  for (std::size_t i = inactive; i < before.landmarks.size(); ++i) {
    const Landmark& landmark = state.landmarks()[i - inactive];
    ASSERT_EQ(before.landmarks[i].id, landmark.id);
    anchored += landmark.anchored ? 1 : 0;
    if (landmark.anchored) continue;
    G.middleRows<3>(State::offsetOf(i)) << Eigen::Matrix3d::Identity(), -so3::hat(landmark.position);
  }
  EXPECT_EQ(anchored, 3u);
  EXPECT_LT(distance(after.covariance - before.covariance, G * noise * G.transpose()),
            1e-10 * after.covariance.norm());
}

TEST(MoveWorld, TakesErrorsAsTheirDefinitionDoes) {
  Random random(24);
  State state = busyState(random);
  const Mean before = meanOf(state);
  const Eigen::MatrixXd P = state.covariance();
  const SE3 T = SE3::Exp((Vector6d() << 30.0, -20.0, 5.0, 0.4, -0.3, 1.9).finished());
  state.moveWorld(T);
  const auto movedBy = [&T](Mean mean) {
    mean.pose = T * mean.pose;
    for (Eigen::Vector3d& landmark : mean.landmarks) landmark = T * landmark;
    return mean;
  };
  const Mean after = movedBy(before);
  EXPECT_LT(distance(state.pose().matrix(), after.pose.matrix()), 1e-12);
  EXPECT_EQ(state.twist(), before.twist);
  for (std::size_t i = 0; i < after.landmarks.size(); ++i)
    EXPECT_LT(distance(state.landmarks()[i].position, after.landmarks[i]), 1e-12);
  const Eigen::MatrixXd J = derivative(
      [&](const Eigen::VectorXd& error) { return errorOf(movedBy(truthAt(before, error)), after); },
      state.size());
  EXPECT_LT(worstCorrelationError(state.covariance(), J * P * J.transpose()), 1e-9);
}

TEST(MoveWorld, LeavesWhatIsSeenFromTheBodyAsItWas) {
  Random random(25);
  State state = busyState(random);
  const Eigen::Matrix3d rotation = state.pose().rotation();
  const auto fromBody = [](const State& s, const Eigen::Matrix3d& R) -> Eigen::Matrix3d {
    const auto P = s.covariance();
    const Eigen::Index i = State::offsetOf(0);
    const Eigen::Matrix3d cross = P.block<3, 3>(i, kPosition);
    const Eigen::Matrix3d C =
        P.block<3, 3>(i, i) + P.block<3, 3>(kPosition, kPosition) - cross - cross.transpose();
    return R.transpose() * C * R;
  };
  const Eigen::Matrix3d before = fromBody(state, rotation);
  state.moveWorld(SE3::Exp((Vector6d() << 300.0, -20.0, 5.0, 0.4, -0.3, 1.9).finished()));
  EXPECT_LT(distance(before, fromBody(state, state.pose().rotation())), 1e-9);
}

TEST(MoveWorld, IsNotForStatesWithInactiveLandmarks) {
  State state(kPrior, true);
  state.addLandmark(1, {1.0, 2.0, 3.0}, Eigen::Matrix3d::Identity());
  state.deactivateLandmark(0);
  EXPECT_THROW(state.moveWorld(SE3()), std::logic_error);
}

} // namespace
} // namespace vi_ekf_slam::invariant
