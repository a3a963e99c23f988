#include "dense_drive.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace vi_ekf_slam::test {

double worstCorrelationError(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected) {
  const Eigen::VectorXd scale = expected.diagonal().cwiseSqrt().cwiseInverse();
  return (scale.asDiagonal() * (actual - expected) * scale.asDiagonal()).cwiseAbs().maxCoeff();
}

Twins::Twins(unsigned seed, std::size_t deferred_bytes)
    : random_(seed), state_(kPrior, true, deferred_bytes), dense_(state_) {
  startMoving();
  for (int i = 0; i < 6; ++i) addLandmark();
}

void Twins::coast() {
  state_.propagate(0.1, kNoise);
  dense_.propagate(0.1, kNoise);
  measureTwist();
}

void Twins::step() {
  coast();
  observe();
  for (int i = 0; i < 2; ++i) addLandmark();
  while (state_.landmarks().size() > 8) {
    if (random_.uniform(0.0, 1.0) < 0.7) {
      deactivateSome(1);
    } else {
      const std::size_t index = pick(state_.landmarks().size());
      state_.removeLandmark(index);
      dense_.removeActive(index);
    }
  }
  if (random_.uniform(0.0, 1.0) < 0.1) {
    state_.forget(kBias, Eigen::Vector3d(0.02, 0.03, 0.04));
    dense_.forget(kBias, Eigen::Vector3d(0.02, 0.03, 0.04));
  }
  if (random_.uniform(0.0, 1.0) < 0.3) {
    const Matrix6d noise = 1e-4 * random_.covariance<6>();
    state_.loosen(noise);
    dense_.loosen(noise);
  }
}

void Twins::deactivateSome(std::size_t count) {
  for (; count > 0; --count) {
    const std::size_t index = pick(state_.landmarks().size());
    const Eigen::Matrix3d slid = 1e-3 * random_.covariance<3>();
    state_.deactivateLandmark(index, slid);
    dense_.deactivate(index, slid);
  }
}

void Twins::activateSome(std::size_t count) {
  std::vector<FeatureId> ids;
  for (std::size_t i = 0; i < count && !dense_.inactive.empty(); ++i) {
    ids.push_back(dense_.inactive[pick(dense_.inactive.size())].id);
    dense_.activate(ids.back());
  }
  state_.activateLandmarks(ids);
  activated_ += ids.size();
}

void Twins::marginaliseOldest(std::size_t count) {
  const std::vector<InactiveLandmark> gone = state_.marginaliseOldest(count);
  ASSERT_EQ(gone.size(), count);
  for (const InactiveLandmark& landmark : gone) {
    const auto found = findInactive(landmark.landmark.id);
    EXPECT_LT(distance(landmark.landmark.position, found->position), 1e-8);
    dense_.removeInactive(static_cast<std::size_t>(found - dense_.inactive.begin()));
  }
}

void Twins::expectEqual() const {
  expectActiveEqual(state_, dense_);
  State all = state_;
  DenseJoint dense = dense_;
  std::vector<FeatureId> ids;
  for (const Landmark& landmark : dense_.inactive) ids.push_back(landmark.id);
  all.activateLandmarks(ids);
  for (const FeatureId id : ids) dense.activate(id);
  EXPECT_EQ(all.inactive().size(), 0u);
  expectActiveEqual(all, dense);
}

void Twins::expectEstimates(InactiveMap::Covariances covariances) const {
  const std::vector<InactiveLandmark> estimates = state_.inactiveLandmarks(covariances);
  ASSERT_EQ(estimates.size(), dense_.inactive.size());
  for (const InactiveLandmark& estimate : estimates) {
    const auto found = findInactive(estimate.landmark.id);
    EXPECT_LT(distance(estimate.landmark.position, found->position), 1e-8);
    EXPECT_EQ(estimate.landmark.observations, found->observations);
    const Eigen::Index row = dense_.inactiveOffset(static_cast<std::size_t>(found - dense_.inactive.begin()));
    const Eigen::Matrix3d exact = dense_.P.block<3, 3>(row, row);
    if (covariances == InactiveMap::Covariances::kExact) {
      EXPECT_LT(worstCorrelationError(estimate.covariance, exact), 1e-9);
    } else {
      const Eigen::Matrix3d more = estimate.covariance - exact;
      EXPECT_TRUE(isPositive(more + 1e-9 * exact.norm() * Eigen::Matrix3d::Identity()));
    }
  }
}

std::size_t Twins::pick(std::size_t count) {
  return std::min(count - 1, static_cast<std::size_t>(random_.uniform(0.0, static_cast<double>(count))));
}

std::vector<Landmark>::const_iterator Twins::findInactive(FeatureId id) const {
  const auto found = std::find_if(dense_.inactive.begin(), dense_.inactive.end(),
                                  [id](const Landmark& landmark) { return landmark.id == id; });
  EXPECT_NE(found, dense_.inactive.end());
  return found;
}

void Twins::apply(const Eigen::MatrixXd& H, const SparseRows& rows, const Eigen::MatrixXd& R,
                  const SE3* camera, const std::optional<Eigen::Matrix3d>& noise) {
  const Update update = updateOf(state_, H, R);
  const Eigen::MatrixXd L = update.S.llt().matrixL();
  const Eigen::VectorXd innovation = 0.5 * L * randomMatrix(random_, H.rows(), 1);
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(H.rows(), dense_.P.rows());
  all.leftCols(H.cols()) = H;
  ASSERT_TRUE(state_.apply(Correction(update.PHt, update.S, innovation, rows, noise), camera));
  dense_.update(all, R, innovation, camera);
}

void Twins::startMoving() {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(6, state_.size());
  SparseRows rows(6);
  for (const Eigen::Index axis : {0, 3}) {
    H.block<3, 3>(axis, kTwist + axis).setIdentity();
    rows.add(axis, kTwist + axis, Eigen::Matrix3d::Identity());
  }
  apply(H, rows, 0.01 * Matrix6d::Identity(), nullptr);
}

void Twins::measureTwist() {
  const Eigen::Index axis = 3 * static_cast<Eigen::Index>(pick(2));
  SparseRows rows(3);
  rows.add(0, kTwist + axis, Eigen::Matrix3d::Identity());
  rows.add(0, kBias + axis, Eigen::Matrix3d::Identity());
  apply(twistRows(state_, axis), rows, 0.01 * random_.covariance<3>(), nullptr);
}

void Twins::observe() {
  std::vector<std::size_t> seen;
  for (std::size_t i = 0; i < state_.landmarks().size(); ++i) {
    if (random_.uniform(0.0, 1.0) < 0.6) seen.push_back(i);
  }
  if (seen.empty()) return;
  const auto count = 3 * static_cast<Eigen::Index>(seen.size());
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(count, state_.size());
  SparseRows rows(count);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const auto row = 3 * static_cast<Eigen::Index>(i);
    const Eigen::Matrix3d J = randomMatrix(random_, 3, 3);
    H.block<3, 3>(row, State::offsetOf(seen[i])) = J;
    H.block<3, 3>(row, kPosition) = -J;
    rows.add(row, State::offsetOf(seen[i]), J);
    rows.add(row, kPosition, -J);
  }
  const Eigen::Vector3d noise(0.01, 0.005, 0.01);
  Eigen::MatrixXd R = Eigen::MatrixXd::Zero(count, count);
  R.diagonal() = noise.replicate(count / 3, 1);
  std::optional<Eigen::Matrix3d> told;
  if (random_.uniform(0.0, 1.0) < 0.7) told = noise.asDiagonal();
  apply(H, rows, R, random_.uniform(0.0, 1.0) < 0.7 ? &rig_.cam_T_imu : nullptr, told);
}

void Twins::addLandmark() {
  const SE3 world_T_cam = state_.pose() * rig_.cam_T_imu.inverse();
  const Eigen::Vector3d q(random_.uniform(-4.0, 4.0), random_.uniform(-1.0, 2.0), random_.uniform(5.0, 20.0));
  const Eigen::Matrix3d noise = 0.1 * random_.covariance<3>();
  state_.addLandmark(next_id_, world_T_cam * q, noise);
  dense_.addLandmark(next_id_++, world_T_cam * q, noise);
}

void Twins::expectActiveEqual(const State& state, const DenseJoint& dense) {
  EXPECT_LT(distance(state.pose().matrix(), dense.pose.matrix()), 1e-8);
  EXPECT_LT(distance(state.twist(), dense.twist), 1e-9);
  EXPECT_LT(distance(state.bias(), dense.bias), 1e-9);
  ASSERT_EQ(state.landmarks().size(), dense.active.size());
  for (std::size_t i = 0; i < dense.active.size(); ++i) {
    EXPECT_EQ(state.landmarks()[i].id, dense.active[i].id);
    EXPECT_LT(distance(state.landmarks()[i].position, dense.active[i].position), 1e-8);
  }
  const Eigen::Index n = state.size();
  EXPECT_LT(distance(state.covariance(), state.covariance().transpose()),
            1e-14 * std::max(1.0, dense.P.cwiseAbs().maxCoeff()));
  EXPECT_LT(worstCorrelationError(state.covariance(), dense.P.topLeftCorner(n, n)), 1e-9);
}

} // namespace vi_ekf_slam::test
