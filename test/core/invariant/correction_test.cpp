#include <limits>

#include "states.hpp"
#include "vi_ekf_slam/core/invariant/inverse_depth.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

TEST(InvariantState, CorrectsAsTheTextbookDoes) {
  Random random(3);
  for (const Eigen::Index axis : {0, 3}) {
    State state = busyState(random);
    const Mean before = meanOf(state);
    const Eigen::MatrixXd P = state.covariance();
    const Eigen::MatrixXd H = twistRows(state, axis);
    const Eigen::Matrix3d R = 0.01 * random.covariance<3>();
    const Eigen::Vector3d innovation = 0.01 * random.vector<3>(-1.0, 1.0);
    const Update update = updateOf(state, H, R);
    const Correction correction(update.PHt, update.S, innovation);
    ASSERT_TRUE(state.apply(correction));
    EXPECT_NEAR(correction.nis(), innovation.dot(inverseOf(update.S) * innovation), 1e-12);

    const Eigen::MatrixXd K = P * H.transpose() * inverseOf(update.S);
    const Eigen::MatrixXd I_KH = Eigen::MatrixXd::Identity(P.rows(), P.cols()) - K * H;
    const Eigen::MatrixXd expected = I_KH * P * I_KH.transpose() + K * R * K.transpose();
    EXPECT_LT(relativeDistance(state.covariance(), expected), 1e-11);
    expectCovariance(state);

    const Eigen::VectorXd error = K * innovation;
    EXPECT_LT(distance(state.twist(), before.twist + error.segment<6>(kTwist)), 1e-12);
    EXPECT_LT(distance(state.bias(), before.bias + error.segment<6>(kBias)), 1e-12);
  }
}

TEST(InvariantState, RetractionIsTheErrorsToFirstOrder) {
  Random random(4);
  const State start = busyState(random);
  const StereoRig rig = exampleRig();
  for (const SE3* camera : {static_cast<const SE3*>(nullptr), &rig.cam_T_imu}) {
    for (const double size : {1e-2, 1e-3}) {
      State state = start;
      const Eigen::MatrixXd H = 0.3 * randomMatrix(random, 6, state.size());
      const Update update = updateOf(state, H, Matrix6d::Identity());
      const Vector6d innovation = size * random.vector<6>(-1.0, 1.0);
      const Eigen::VectorXd error = update.PHt * inverseOf(update.S) * innovation;
      ASSERT_TRUE(state.apply(Correction(update.PHt, update.S, innovation), camera));
      const Eigen::VectorXd made = errorOf(meanOf(state), meanOf(start));
      EXPECT_LT(distance(made, error), 20.0 * error.squaredNorm());
      EXPECT_TRUE(so3::isRotation(state.pose().rotation(), 1e-12));
    }
  }
}

TEST(InvariantState, RefusesAnUpdateThatIsNoneAndStaysAsItWas) {
  Random random(5);
  const State start = busyState(random);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Update good = updateOf(start, twistRows(start, 0), Eigen::Matrix3d::Identity());
  const Eigen::Vector3d innovation(0.1, 0.2, 0.3);
  const auto expectRefused = [&](const Eigen::MatrixXd& PHt, const Eigen::MatrixXd& S,
                                 const Eigen::VectorXd& y) {
    State state = start;
    EXPECT_FALSE(state.apply(Correction(PHt, S, y)));
    EXPECT_EQ(distance(state.covariance(), start.covariance()), 0.0);
    EXPECT_EQ(distance(state.pose().matrix(), start.pose().matrix()), 0.0);
    EXPECT_EQ(distance(state.twist(), start.twist()), 0.0);
  };
  expectRefused(good.PHt, -good.S, innovation);
  expectRefused(good.PHt, nan * good.S, innovation);
  expectRefused(good.PHt, good.S, nan * innovation);
  expectRefused(nan * good.PHt, good.S, innovation);
}

TEST(InvariantState, ForgetsTheTwist) {
  Random random(9);
  for (const Eigen::Index row : {kTwist, kTwist + 3}) {
    State state = busyState(random);
    Eigen::MatrixXd expected = state.covariance();
    expected.middleRows<3>(row).setZero();
    expected.middleCols<3>(row).setZero();
    const Eigen::Vector3d sigma(1.0, 2.0, 3.0);
    expected.diagonal().segment<3>(row) = sigma.cwiseAbs2();
    state.forget(row, sigma);
    EXPECT_EQ(distance(state.covariance(), expected), 0.0);
  }
}

TEST(InvariantState, ReportsCovariancesAlongTheWorldAxes) {
  Random random(10);
  const State state = busyState(random);
  const Mean estimate = meanOf(state);
  const Eigen::MatrixXd P = state.covariance();
  const Eigen::MatrixXd pose = derivative(
      [&](const Eigen::VectorXd& error) {
        const SE3 truth = truthAt(estimate, error).pose;
        Eigen::VectorXd d(6);
        d << truth.translation() - estimate.pose.translation(),
            so3::Log(truth.rotation() * estimate.pose.rotation().transpose());
        return d;
      },
      state.size());
  EXPECT_LT(relativeDistance(state.poseCovariance(), pose * P * pose.transpose()), 1e-8);
  for (std::size_t i = 0; i < estimate.landmarks.size(); ++i) {
    const Eigen::MatrixXd J = derivative(
        [&](const Eigen::VectorXd& error) -> Eigen::VectorXd {
          return truthAt(estimate, error).landmarks[i];
        },
        state.size());
    EXPECT_LT(relativeDistance(state.landmarkCovariance(i), J * P * J.transpose()), 1e-8);
  }
}

TEST(InvariantState, MovesALandmarkWithItsCovarianceInInverseDepth) {
  Random random(16);
  const StereoModel model(exampleRig(), 0.7, 0.5);
  for (int run = 0; run < 20; ++run) {
    const State start = busyState(random, 4);
    const auto observations = observationsOf(model, start, 3.0, random);
    const Eigen::MatrixXd PHt = model.crossCovariance(start, observations);
    const Eigen::MatrixXd S = model.innovationCovariance(observations, PHt);
    State still = start, with = start;
    still.apply(Correction(PHt, S, Eigen::VectorXd::Zero(S.rows())), &model.rig().cam_T_imu);
    with.apply(Correction(PHt, S, stackInnovations(observations)), &model.rig().cam_T_imu);
    expectCovariance(with);
    // The covariance of all, with (x/z, y/z, 1/z) in place of the landmarks' errors, must not have changed.
    const SE3 cam_T_world = model.rig().cam_T_imu * with.pose().inverse();
    const auto inInverseDepth = [&](const State& state) {
      Eigen::MatrixXd A = Eigen::MatrixXd::Identity(state.size(), state.size());
      for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
        const Eigen::Matrix3d J =
            InverseDepth::jacobian(cam_T_world * state.landmarks()[i].position) * cam_T_world.rotation();
        A.block<3, 3>(State::offsetOf(i), State::offsetOf(i)) = J;
        A.block<3, 3>(State::offsetOf(i), kPosition) = -J;
      }
      return Eigen::MatrixXd(A * state.covariance() * A.transpose());
    };
    const Eigen::MatrixXd expected = inInverseDepth(still), actual = inInverseDepth(with);
    EXPECT_GT(distance(with.landmarks()[0].position, still.landmarks()[0].position), 1e-3);
    EXPECT_LT(distance(actual, expected), 1e-12);
  }
}

} // namespace
} // namespace vi_ekf_slam::invariant
