#include "vi_ekf_slam/front_end/anchor_patch.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace vi_ekf_slam {
namespace {

constexpr int kMaxIterations = 20;
// Of the last step, px, which is taken: then 0.009 px RMS are left to go (0.0024 with a quarter of both).
constexpr float kConverged = 0.02f;
// px at the patch's edge, of the shape as well. What it lags behind where a wall comes nearer is to the same
// side in each picture: then the points on both sides of a street stray to the outside.
constexpr float kShapeConverged = 0.1f;
constexpr float kMinContrast = 1.0f; // grey levels, RMS
// How well shape and slant are known beforehand, 0.15 px at the patch's edge, where a tenth of the contrast
// is noise: (0.1^2 / 225) / 0.15^2. It holds those that a patch hardly shows; with a seventh and with five
// times of it drawn streets and recorded drives are no better (docs/front_end.md).
constexpr float kPrior = 0.002f;
// Of the normal equations' diagonal after a step that was none, and what it falls by after each that was
// (Marquardt 1963).
constexpr float kDamping = 0.25f, kLess = 0.25f;
// Of a step: central differences of fine texture are less than its slope, and whole steps go too far. On
// recorded and drawn pictures 0.8 to 0.9 need a tenth fewer of them than 1, and 0.7 as many.
constexpr float kStep = 0.85f;
constexpr float kLeastScale = 0.5f; // of 1 + slant^T xi
constexpr float kRounding = 0.01f;  // px, more than what is lost of 16384

// The patch and a pixel around it, for gradients; filled up as AnchorPatch has it.
constexpr int kWideHalf = AnchorPatch::kHalf + 1, kWide = 2 * kWideHalf + 1;
constexpr int kSamples = kWide * kWide, kPaddedSamples = (kSamples + 15) / 16 * 16;
using Samples = Eigen::Array<float, kPaddedSamples, 1>;

/// px, across or down, from the centre of a square of `side` px.
template <typename Values>
Values grid(int side, bool is_across) {
  Values values = Values::Zero();
  for (int i = 0; i < side * side; ++i)
    values[i] = static_cast<float>((is_across ? i % side : i / side) - side / 2);
  return values;
}

/// Bilinear samples of the patch and a pixel around it; false where one is not inside the image. In steps
/// that run in vectors, but for the one that fetches pixels.
bool sample(const cv::Mat& image, const AnchorPatch::Warp& warp, Samples& out) {
  constexpr auto side = static_cast<float>(kWideHalf);
  const float scale = 1.0f - side * warp.slant.lpNorm<1>(); // the least one
  if (!(scale > kLeastScale)) return false;
  const float reach_x = side / scale * warp.shape.row(0).lpNorm<1>();
  const float reach_y = side / scale * warp.shape.row(1).lpNorm<1>();
  const float cx = warp.centre.x(), cy = warp.centre.y();
  const Eigen::Matrix2f& A = warp.shape;
  const bool is_inside = cx - reach_x >= 0.0f && cy - reach_y >= 0.0f &&
                         cx + reach_x < static_cast<float>(image.cols - 1) - kRounding &&
                         cy + reach_y < static_cast<float>(image.rows - 1) - kRounding;
  if (!is_inside) return false; // NaN too
  static const Samples u = grid<Samples>(kWide, true), v = grid<Samples>(kWide, false);
  const Samples inverse = (1.0f + warp.slant.x() * u + warp.slant.y() * v).inverse();
  const Samples x = cx + (A(0, 0) * u + A(0, 1) * v) * inverse;
  const Samples y = cy + (A(1, 0) * u + A(1, 1) * v) * inverse;
  const auto stride = static_cast<int>(image.step);
  std::array<int, kPaddedSamples> offset;
  Samples right, below;
  for (int i = 0; i < kPaddedSamples; ++i) {
    const int x0 = static_cast<int>(x[i]), y0 = static_cast<int>(y[i]);
    right[i] = x[i] - static_cast<float>(x0);
    below[i] = y[i] - static_cast<float>(y0);
    offset[i] = y0 * stride + x0;
  }
  const auto* data = image.ptr<std::uint8_t>();
  std::array<std::uint8_t, 2 * kPaddedSamples> upper, lower; // pairs of neighbours
  for (int i = 0; i < kPaddedSamples; ++i) {
    std::copy_n(data + offset[i], 2, &upper[2 * i]);
    std::copy_n(data + offset[i] + stride, 2, &lower[2 * i]);
  }
  for (int i = 0; i < kPaddedSamples; ++i) {
    const auto a = static_cast<float>(upper[2 * i]), b = static_cast<float>(upper[2 * i + 1]);
    const auto c = static_cast<float>(lower[2 * i]), d = static_cast<float>(lower[2 * i + 1]);
    const float top = a + right[i] * (b - a), bottom = c + right[i] * (d - c);
    out[i] = top + below[i] * (bottom - top);
  }
  return true;
}

constexpr int kShape = 6; // of them all but the shift

/// The warp of what `step` does to the patch.
AnchorPatch::Warp compose(const AnchorPatch::Warp& warp, const AnchorPatch::Parameters& step) {
  constexpr float half = AnchorPatch::kHalf;
  Eigen::Matrix3f first = Eigen::Matrix3f::Identity(), then = Eigen::Matrix3f::Identity();
  first.topRightCorner<2, 1>() = step.head<2>();
  first.topLeftCorner<2, 2>() +=
      Eigen::Map<const Eigen::Matrix<float, 2, 2, Eigen::RowMajor>>(&step[2]) / half;
  first.bottomLeftCorner<1, 2>() = step.tail<2>().transpose() / (half * half);
  then.topLeftCorner<2, 2>() = warp.shape;
  then.bottomLeftCorner<1, 2>() = warp.slant.transpose();
  Eigen::Matrix3f both = then * first;
  both /= both(2, 2);
  const Eigen::Vector2f shift = both.topRightCorner<2, 1>();
  AnchorPatch::Warp composed;
  composed.centre = warp.centre + shift;
  composed.slant = both.bottomLeftCorner<1, 2>().transpose();
  composed.shape = both.topLeftCorner<2, 2>() - shift * composed.slant.transpose();
  return composed;
}

} // namespace

bool AnchorPatch::look(const cv::Mat& image, const Warp& warp, View& view) {
  Samples wide;
  if (!sample(image, warp, wide)) return false;
  for (int v = 0; v < kSide; ++v) {
    const auto row = [&wide, v](int below, int right) {
      return wide.segment<kSide>((v + 1 + below) * kWide + 1 + right);
    };
    view.values.segment<kSide>(v * kSide) = row(0, 0).matrix();
    view.across.segment<kSide>(v * kSide) = 0.5f * (row(0, 1) - row(0, -1)).matrix();
    view.down.segment<kSide>(v * kSide) = 0.5f * (row(1, 0) - row(-1, 0)).matrix();
  }
  view.values.head<kPixels>().array() -= view.values.sum() / kPixels;
  const float norm = view.values.norm();
  if (norm < kMinContrast * std::sqrt(static_cast<float>(kPixels))) return false;
  view.values /= norm;
  view.across /= norm;
  view.down /= norm;
  return true;
}

std::unique_ptr<const AnchorPatch> AnchorPatch::cut(const cv::Mat& image, const cv::Point2f& centre) {
  auto patch = std::make_unique<AnchorPatch>();
  if (!look(image, {{centre.x, centre.y}}, patch->view_)) return nullptr;
  return patch;
}

AnchorPatch::Normal AnchorPatch::linearise(const View& there, float correlation) const {
  constexpr float half = kHalf;
  static const Pixels x = grid<Pixels>(kSide, true) / half, y = grid<Pixels>(kSide, false) / half;
  Eigen::Matrix<float, kPadded, Parameters::RowsAtCompileTime> J;
  // Between both views: the error is of second order then.
  J.col(0) = 0.5f * (view_.across + there.across);
  J.col(1) = 0.5f * (view_.down + there.down);
  J.col(2) = J.col(0).cwiseProduct(x);
  J.col(3) = J.col(0).cwiseProduct(y);
  J.col(4) = J.col(1).cwiseProduct(x);
  J.col(5) = J.col(1).cwiseProduct(y);
  const Pixels outward = J.col(2) + J.col(5);
  J.col(6) = -outward.cwiseProduct(x);
  J.col(7) = -outward.cwiseProduct(y);
  // Without what brightness and contrast explain.
  const Parameters of_mean = J.colwise().sum() / std::sqrt(static_cast<float>(kPixels));
  const Parameters of_contrast = J.transpose().lazyProduct(view_.values);
  Normal normal;
  for (Eigen::Index i = 0; i < J.cols(); ++i) { // faster than a product of so few columns
    for (Eigen::Index k = 0; k <= i; ++k) normal.H(i, k) = normal.H(k, i) = J.col(i).dot(J.col(k));
  }
  normal.H -= of_mean * of_mean.transpose() + of_contrast * of_contrast.transpose();
  const Pixels error = view_.values - there.values;
  normal.b = J.transpose().lazyProduct(error) - (1.0f - correlation) * of_contrast;
  return normal;
}

std::optional<AnchorPatch::Fit> AnchorPatch::align(const cv::Mat& image, const Warp& start) const {
  Fit fit{start, 0.0};
  Parameters moved = Parameters::Zero(), step = Parameters::Zero();
  Normal normal;
  View there;
  float least = std::numeric_limits<float>::infinity(), damping = 0.0f;
  for (int k = 0; k < kMaxIterations; ++k) {
    const Warp warp = compose(fit.warp, step);
    const bool is_seen = look(image, warp, there);
    if (!is_seen && k == 0) return std::nullopt;
    const float correlation = is_seen ? there.values.dot(view_.values) : -1.0f;
    const float cost = 2.0f * (1.0f - correlation) + kPrior * (moved + step).tail<kShape>().squaredNorm();
    if (cost < least) {
      least = cost;
      fit = {warp, static_cast<double>(correlation)};
      moved += step;
      normal = linearise(there, correlation);
      normal.H.diagonal().tail<kShape>().array() += kPrior;
      normal.b.tail<kShape>() -= kPrior * moved.tail<kShape>();
      damping *= kLess;
    } else {
      damping = std::max(damping / kLess, kDamping);
    }
    Eigen::Matrix<float, 8, 8> damped = normal.H;
    damped.diagonal() *= 1.0f + damping;
    step = kStep * damped.llt().solve(normal.b);
    if (!step.allFinite()) return std::nullopt;
    if (step.head<2>().norm() < kConverged && step.tail<kShape>().norm() < kShapeConverged) {
      fit.warp = compose(fit.warp, step);
      return fit;
    }
  }
  return std::nullopt;
}

} // namespace vi_ekf_slam
