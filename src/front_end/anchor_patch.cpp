#include "vi_ekf_slam/front_end/anchor_patch.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <array>
#include <cmath>

namespace vi_ekf_slam {
namespace {

constexpr int kMaxIterations = 20;
constexpr float kConverged = 0.005f; // px
// px at the patch's edge, of the shape as well. What it lags behind where a wall comes nearer is to the same
// side in each picture: then the points on both sides of a street stray to the outside.
constexpr float kShapeConverged = 0.03f;
constexpr float kMinContrast = 1.0f; // grey levels, RMS
// Of the shape's steps, as a share of what the patch's contrast tells (Marquardt 1963): with less of it more
// fits run away, with more they end before they are there
// (AnchorPatch.stays_on_points_of_walls_that_come_nearer).
constexpr float kDamping = 0.04f;
constexpr float kLeastScale = 0.5f; // of 1 + slant^T xi

/// Bilinear samples on the grid of the patch; false where one is not inside the image.
template <typename Pixels>
bool sample(const cv::Mat& image, const AnchorPatch::Warp& warp, int half, Pixels& out) {
  const auto side = static_cast<float>(half);
  const float scale = 1.0f - side * warp.slant.lpNorm<1>(); // the least one
  if (!(scale > kLeastScale)) return false;
  const float reach_x = side / scale * warp.shape.row(0).lpNorm<1>();
  const float reach_y = side / scale * warp.shape.row(1).lpNorm<1>();
  const float cx = warp.centre.x(), cy = warp.centre.y();
  const Eigen::Matrix2f& A = warp.shape;
  const bool is_inside = cx - reach_x >= 0.0f && cy - reach_y >= 0.0f &&
                         cx + reach_x < static_cast<float>(image.cols - 1) &&
                         cy + reach_y < static_cast<float>(image.rows - 1);
  if (!is_inside) return false; // NaN too
  const auto* data = image.ptr<std::uint8_t>();
  const auto stride = static_cast<int>(image.step);
  constexpr int kMostInRow = AnchorPatch::kSide + 2;
  std::array<float, kMostInRow> xs, ys; // apart from what does not run in vectors
  Eigen::Index i = 0;
  for (int v = -half; v <= half; ++v) {
    const auto row = static_cast<float>(v);
    for (int k = 0; k <= 2 * half; ++k) {
      const auto column = static_cast<float>(k - half);
      const float inverse = 1.0f / (1.0f + warp.slant.x() * column + warp.slant.y() * row);
      xs[k] = cx + (A(0, 0) * column + A(0, 1) * row) * inverse;
      ys[k] = cy + (A(1, 0) * column + A(1, 1) * row) * inverse;
    }
    for (int k = 0; k <= 2 * half; ++k, ++i) {
      const float x = xs[k], y = ys[k];
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
  if (!sample(image, {{centre.x, centre.y}}, kHalf + 1, wide)) return std::nullopt;
  AnchorPatch patch;
  patch.values_.setZero();
  Eigen::Matrix<float, kPadded, kParameters> J = decltype(J)::Zero();
  Eigen::Index i = 0;
  for (int v = -kHalf; v <= kHalf; ++v) {
    for (int u = -kHalf; u <= kHalf; ++u, ++i) {
      const int k = (v + kHalf + 1) * kWide + u + kHalf + 1;
      const float gx = 0.5f * (wide[k + 1] - wide[k - 1]), gy = 0.5f * (wide[k + kWide] - wide[k - kWide]);
      const float x = static_cast<float>(u) / kHalf, y = static_cast<float>(v) / kHalf;
      patch.values_[i] = wide[k];
      const float outward = gx * x + gy * y;
      J.row(i) << gx, gy, gx * x, gx * y, gy * x, gy * y, -outward * x, -outward * y;
    }
  }
  const float norm = normalise(patch.values_);
  if (norm == 0.0f) return std::nullopt;
  const Eigen::Matrix<float, 1, kParameters> mean = J.colwise().sum() / kPixels;
  // What brightness and contrast explain.
  J.topRows<kPixels>().rowwise() -= mean;
  J -= patch.values_ * (patch.values_.transpose() * J).eval();
  Eigen::Matrix<float, kParameters, kParameters> H = J.transpose() * J;
  H.diagonal().tail<kParameters - 2>().array() += kDamping * norm * norm;
  const Eigen::LDLT<decltype(H)> information(H);
  if (!information.isPositive()) return std::nullopt;
  patch.gain_ = information.solve(norm * J.transpose());
  return patch;
}

std::optional<AnchorPatch::Fit> AnchorPatch::align(const cv::Mat& image, const Warp& start) const {
  Fit fit{start, 0.0};
  Pixels there = Pixels::Zero();
  for (int k = 0; k < kMaxIterations; ++k) {
    if (!sample(image, fit.warp, kHalf, there) || normalise(there) == 0.0f) return std::nullopt;
    fit.correlation = static_cast<double>(there.dot(values_));
    const Eigen::Matrix<float, kParameters, 1> step = gain_ * (there - values_);
    // A homography is what the patch would have to do; the warp does its inverse.
    Eigen::Matrix3f change = Eigen::Matrix3f::Identity(), warp = Eigen::Matrix3f::Identity();
    change.topRightCorner<2, 1>() = step.head<2>();
    change.topLeftCorner<2, 2>() +=
        Eigen::Map<const Eigen::Matrix<float, 2, 2, Eigen::RowMajor>>(&step[2]) / kHalf;
    change.bottomLeftCorner<1, 2>() = step.tail<2>().transpose() / (kHalf * kHalf);
    warp.topLeftCorner<2, 2>() = fit.warp.shape;
    warp.bottomLeftCorner<1, 2>() = fit.warp.slant.transpose();
    warp = (warp * change.inverse()).eval();
    warp /= warp(2, 2);
    const Eigen::Vector2f shift = warp.topRightCorner<2, 1>();
    fit.warp.slant = warp.bottomLeftCorner<1, 2>().transpose();
    fit.warp.shape = warp.topLeftCorner<2, 2>() - shift * fit.warp.slant.transpose();
    fit.warp.centre += shift;
    if (!warp.allFinite()) return std::nullopt;
    if (shift.norm() < kConverged && step.tail<kParameters - 2>().norm() < kShapeConverged) return fit;
  }
  return std::nullopt;
}

} // namespace vi_ekf_slam
