#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "../covariances.hpp"
#include "../numeric.hpp"
#include "../street.hpp"
#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/motion/constant_twist.hpp"
#include "vi_ekf_slam/core/observation/stereo_model.hpp"

/// Filters to be tested with, and their errors written as their definition stands.
namespace vi_ekf_slam::test {

Eigen::MatrixXd randomMatrix(Random& random, Eigen::Index rows, Eigen::Index cols);

Eigen::MatrixXd randomCovariance(Random& random, Eigen::Index size, double variance);

ConstantTwist::Options noisyMotion();

ConstantTwist::Options withoutNoise(ConstantTwist::Options options);

/// A filter with a model of motion, a stereo pair, and points.
struct Scene {
  Filter filter;
  ConstantTwist motion;
  std::optional<Handle> scale;
  std::vector<Handle> points;

  StereoModel model() const;
  SE3 worldTCam() const { return model().camTWorld(filter).inverse(); }
  /// A point before the camera, independent of all else; `variance` about what it is along each axis, m^2.
  void addPoint(Random& random, double variance = 0.1);
  StereoPixels expectedPixels(Handle point) const;
  /// All points, seen up to `offset` px from where they are expected.
  std::vector<LinearMeasurement> seen(Random& random, double offset) const;
};

/// At rest far from the origin, with nothing but the core.
Scene coreScene(Random& random, const RigVariables::Options& rig,
                const ConstantTwist::Options& options = noisyMotion());

/// A calibration of which the baseline alone may not be known.
RigVariables::Options scaleOf(double sigma);

Scene coreScene(Random& random, double scale_sigma = 0.0,
                const ConstantTwist::Options& options = noisyMotion());

/// Moving and turning, with `points` of them in view, everything correlated.
Scene busyScene(Random& random, std::size_t points, const RigVariables::Options& rig);

Scene busyScene(Random& random, std::size_t points = 3, double scale_sigma = 0.0);

/// The variable of this name, which the filter has.
inline Handle handleOf(const Filter& filter, const std::string& name) {
  return filter.variables().find(name).value();
}

/// For what a constant twist does not need.
inline const ImuTrack kNoImu({}, false);

/// A truth or a mean: the pose, and what the other variables are, row by row.
struct State {
  SE3 pose;
  Eigen::VectorXd x;
};

State stateOf(const Filter& filter);

/// The truth that lies `error` from `estimate`, by the definition of the error.
State truthAt(const Variables& variables, const State& estimate, const Eigen::VectorXd& error);

Eigen::VectorXd errorOf(const Variables& variables, const State& truth, const State& estimate);

/// Numeric derivative of f(error) at no error.
Eigen::MatrixXd derivative(const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& f,
                           Eigen::Index size);

/// H of one measurement, `cols` wide.
Eigen::MatrixXd denseOf(const LinearMeasurement& z, Eigen::Index cols);

/// Measurements as one: residual, H and the covariance of the noise.
struct DenseMeasurement {
  Eigen::VectorXd residual;
  Eigen::MatrixXd H, R;
};

DenseMeasurement denseOf(const std::vector<LinearMeasurement>& all, Eigen::Index cols);

/// Corrects by all at once, in straight coordinates or in those of `chart`.
void correct(Filter& filter, const std::vector<LinearMeasurement>& all, const PointChart& chart = {});

/// The same in the coordinates in which a camera corrects points.
void correctSeen(Filter& filter, const std::vector<LinearMeasurement>& all, const StereoModel& model);

/// Directions of the pose's error that shift and turn the whole world about the origin: of every other error
/// they have nothing.
Eigen::MatrixXd gaugeOf(const Filter& filter);

/// P with ones on its diagonal, and the factors that make it so.
struct Scaled {
  explicit Scaled(const Eigen::MatrixXd& P);
  Eigen::VectorXd factors;
  Eigen::MatrixXd matrix;
};

/// What is known about the directions `N` when nothing else is free: N^T P^-1 N.
Eigen::MatrixXd informationOf(const Eigen::MatrixXd& P, const Eigen::MatrixXd& N);

/// (P - Q)_ij / (sigma_i sigma_j), the worst one, sigma those of Q.
double worstCorrelationError(const Eigen::MatrixXd& P, const Eigen::MatrixXd& Q);

/// Whether the correlations have a Cholesky factor with so much added to their diagonal.
bool isJointlyPositive(const Eigen::MatrixXd& P, double jitter = 1e-9);

void expectCovariance(const Eigen::MatrixXd& P);

/// (rows() square) T x are the errors x along the world's axes: of points x - x^ in the place of y.
Eigen::MatrixXd worldAxesOf(const Filter& filter);

/// Of all active errors, and behind them those that are inactive along the world axes.
Eigen::MatrixXd jointOf(Filter filter);

/// The same with everything active again.
Eigen::MatrixXd activatedOf(Filter filter);

} // namespace vi_ekf_slam::test
