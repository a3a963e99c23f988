#include "vi_ekf_slam/front_end/anchor_patch.hpp"

#include <Eigen/LU>
#include <cmath>

namespace vi_ekf_slam {
namespace {

constexpr int kMaxIterations = 10;
constexpr float kConverged = 0.005f; // px
constexpr float kMinContrast = 1.0f; // grey levels, RMS
// The shape changes slowly: each step is held by what its prior standard deviation says beside the noise of
// the pixels.
constexpr float kShapeSigma = 0.05f, kPixelNoise = 4.0f; // 1 at the patch's edge, grey levels

/// Bilinear samples on the grid of the patch; false where one is not inside the image.
template <typename Pixels>
bool sample(const cv::Mat& image, const AnchorPatch::Warp& warp, int half, Pixels& out) {
  const float reach_x = static_cast<float>(half) * (std::abs(warp.shape(0, 0)) + std::abs(warp.shape(0, 1)));
  const float reach_y = static_cast<float>(half) * (std::abs(warp.shape(1, 0)) + std::abs(warp.shape(1, 1)));
  const float cx = warp.centre.x(), cy = warp.centre.y();
  const bool is_inside = cx - reach_x >= 0.0f && cy - reach_y >= 0.0f &&
                         cx + reach_x < static_cast<float>(image.cols - 1) &&
                         cy + reach_y < static_cast<float>(image.rows - 1);
  if (!is_inside) return false; // NaN too
  const auto* data = image.ptr<std::uint8_t>();
  const auto stride = static_cast<int>(image.step);
  Eigen::Index i = 0;
  for (int v = -half; v <= half; ++v) {
    const float row_x = cx + warp.shape(0, 1) * static_cast<float>(v);
    const float row_y = cy + warp.shape(1, 1) * static_cast<float>(v);
    for (int u = -half; u <= half; ++u, ++i) {
      const float x = row_x + warp.shape(0, 0) * static_cast<float>(u);
      const float y = row_y + warp.shape(1, 0) * static_cast<float>(u);
      const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
      const float a = x - static_cast<float>(x0), b = y - static_cast<float>(y0);
      const auto* p = data + y0 * stride + x0;
      const float top = static_cast<float>(p[0]) + a * static_cast<float>(p[1] - p[0]);
      const float bottom = static_cast<float>(p[stride]) + a * static_cast<float>(p[stride + 1] - p[stride]);
      out[i] = top + b * (bottom - top);
    }
  }
  return true;
}

/// Mean 0 and norm 1 of the pixels, which zeros follow; the norm before, 0 where there is no contrast.
template <typename Pixels>
float normalise(Pixels& values) {
  constexpr int kPixels = AnchorPatch::kPixels;
  values.template head<kPixels>().array() -= values.sum() / kPixels;
  const float norm = values.norm();
  if (norm < kMinContrast * std::sqrt(static_cast<float>(kPixels))) return 0.0f;
  values /= norm;
  return norm;
}

} // namespace

std::optional<AnchorPatch> AnchorPatch::cut(const cv::Mat& image, const cv::Point2f& centre) {
  constexpr int kWide = kSide + 2;
  Eigen::Matrix<float, kWide * kWide, 1> wide;
  if (!sample(image, {{centre.x, centre.y}, Eigen::Matrix2f::Identity()}, kHalf + 1, wide))
    return std::nullopt;
  AnchorPatch patch;
  patch.values_.setZero();
  patch.J_.setZero();
  Eigen::Index i = 0;
  for (int v = -kHalf; v <= kHalf; ++v) {
    for (int u = -kHalf; u <= kHalf; ++u, ++i) {
      const int k = (v + kHalf + 1) * kWide + u + kHalf + 1;
      const float gx = 0.5f * (wide[k + 1] - wide[k - 1]), gy = 0.5f * (wide[k + kWide] - wide[k - kWide]);
      const float x = static_cast<float>(u) / kHalf, y = static_cast<float>(v) / kHalf;
      patch.values_[i] = wide[k];
      patch.J_.row(i) << gx, gy, gx * x, gx * y, gy * x, gy * y;
    }
  }
  patch.norm_ = normalise(patch.values_);
  if (patch.norm_ == 0.0f) return std::nullopt;
  const Eigen::Matrix<float, 1, 6> mean = patch.J_.colwise().sum() / kPixels;
  patch.J_.topRows<kPixels>().rowwise() -= mean;
  patch.J_ -= patch.values_ * (patch.values_.transpose() * patch.J_).eval();
  Eigen::Matrix<float, 6, 6> H = patch.J_.transpose() * patch.J_;
  const float prior = kPixelNoise * kPixelNoise / (kShapeSigma * kShapeSigma);
  H.diagonal().tail<4>().array() += prior;
  patch.information_.compute(H);
  if (patch.information_.info() != Eigen::Success) return std::nullopt;
  return patch;
}

std::optional<AnchorPatch::Fit> AnchorPatch::align(const cv::Mat& image, const Warp& start) const {
  Fit fit{start, 0.0};
  Pixels there = Pixels::Zero();
  for (int k = 0; k < kMaxIterations; ++k) {
    if (!sample(image, fit.warp, kHalf, there) || normalise(there) == 0.0f) return std::nullopt;
    fit.correlation = static_cast<double>(there.dot(values_));
    const Eigen::Matrix<float, 6, 1> step = information_.solve(J_.transpose() * (norm_ * (there - values_)));
    // W(xi) = (I + D) xi + d is what the patch would have to do; the warp does its inverse.
    Eigen::Matrix2f change;
    change << step[2], step[3], step[4], step[5];
    const Eigen::Matrix2f inverse = (Eigen::Matrix2f::Identity() + change / kHalf).inverse();
    const Eigen::Vector2f shift = fit.warp.shape * (inverse * step.head<2>());
    fit.warp.shape = fit.warp.shape * inverse;
    fit.warp.centre -= shift;
    if (!fit.warp.centre.allFinite() || !fit.warp.shape.allFinite()) return std::nullopt;
    if (shift.norm() < kConverged) return fit;
  }
  return std::nullopt;
}

} // namespace vi_ekf_slam
