#pragma once

#include <optional>
#include <vector>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/geometry/camera.hpp"

namespace vi_ekf_slam {

/// The disparities in view as draws from one distribution, for landmarks that start while neither rotation
/// nor velocity is known. Then the flow of a frame is a line, f (omega + rho_i v), of which both are fitted,
/// and the noise of rho_i makes its slope too flat by t^2 / (t^2 + s^2), where t^2 is the variance of the
/// true disparities and s^2 that of their noise (errors in variables; Fuller, "Measurement Error Models",
/// 1987). With the best linear predictor of each, m + k (d - m), k = t^2 / (t^2 + s^2), it is right: what is
/// left, of variance k s^2, is independent of it. The error of the mean m is common to all: a variable.
class SceneDisparities {
 public:
  /// Adds the mean to `filter`. Nothing when they are too few for a variance.
  static std::optional<SceneDisparities> of(Filter& filter, const std::vector<double>& disparities,
                                            double noise_variance);

  /// What the pixels are taken for, and the covariance of that (4 x 4, px^2) but for the mean's part: by
  /// `unknown` (1 - k) of the mean's error the disparity is wrong.
  struct Predicted {
    StereoPixels pixels;
    Eigen::Matrix4d noise;
    double unknown;
  };
  Predicted predict(const Filter& filter, const StereoPixels& pixels, double sigma) const;

  Handle mean() const { return mean_; } ///< px

 private:
  SceneDisparities(Handle mean, double variance) : mean_(mean), variance_(variance) {}

  Handle mean_;
  double variance_; ///< px^2, of the true disparities
};

} // namespace vi_ekf_slam
