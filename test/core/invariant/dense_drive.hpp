#pragma once

#include <optional>

#include "dense_joint.hpp"

namespace vi_ekf_slam::test {

/// The largest difference of two covariances, relative to the standard deviations of its row and column.
double worstCorrelationError(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected);

/// A random drive, done by State and by DenseJoint alike.
class Twins {
 public:
  explicit Twins(unsigned seed, std::size_t deferred_bytes = std::size_t{1} << 30);

  const State& state() const { return state_; }
  const DenseJoint& dense() const { return dense_; }
  std::size_t activated() const { return activated_; }

  void step();
  /// Nothing is seen, nothing comes: two steps of the journal.
  void coast();
  void deactivateSome(std::size_t count);
  void activateSome(std::size_t count);
  void marginaliseOldest(std::size_t count);
  double compose(double operations) { return state_.compose(operations); }

  /// Every mean and, with all landmarks active, every entry of the joint covariance.
  void expectEqual() const;
  void expectEstimates(InactiveMap::Covariances covariances) const;

 private:
  std::size_t pick(std::size_t count);

  std::vector<Landmark>::const_iterator findInactive(FeatureId id) const;
  void apply(const Eigen::MatrixXd& H, const SparseRows& rows, const Eigen::MatrixXd& R, const SE3* camera,
             const std::optional<Eigen::Matrix3d>& noise = {});
  void startMoving();
  void measureTwist();
  void observe();
  void addLandmark();

  static void expectActiveEqual(const State& state, const DenseJoint& dense);

  Random random_;
  StereoRig rig_ = exampleRig();
  State state_;
  DenseJoint dense_;
  FeatureId next_id_ = 1;
  std::size_t activated_ = 0;
};

} // namespace vi_ekf_slam::test
