#include "vi_ekf_slam/core/invariant/composition.hpp"

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/columns3.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/symmetric.hpp"

namespace vi_ekf_slam::invariant {

double costOf(const DeferredStep& step) {
  const auto* update = std::get_if<KalmanUpdate>(&step);
  if (!update) return 0.0;
  const auto r = static_cast<double>((*update->Kt).rows()), n = static_cast<double>((*update->Kt).cols());
  return 5.0 * n * n * r;
}

Eigen::Index gainOf(const DeferredStep& step) {
  if (std::holds_alternative<Birth>(step)) return 3;
  return std::holds_alternative<Removal>(step) ? -3 : 0;
}

Composition::Composition(Chunks chunks, Departures departures)
    : chunks_(std::move(chunks)), departures_(std::move(departures)) {
  const Eigen::Index begin = chunks_.front()->size, left = rowsOf(departures_.size());
  Eigen::Index size = begin, largest = begin;
  for (const auto& chunk : chunks_) {
    for (const DeferredStep& step : chunk->steps) largest = std::max(largest, size += gainOf(step));
  }
  sweep_.emplace(begin, left, largest);
  leaving_ = PooledMatrix::Zero(begin + left, left + 1); // never empty: it is taken in parts
}

double Composition::advance(double operations) {
  const double before = cost_;
  while (!isDone() && cost_ - before < operations) {
    const PooledVector<DeferredStep>& steps = chunks_[chunk_]->steps;
    if (step_ < steps.size()) {
      cost_ += costOf(steps[step_]);
      forward(steps[step_++]);
    } else {
      ++chunk_;
      step_ = 0;
    }
  }
  return cost_ - before;
}

void Composition::forward(const DeferredStep& step) {
  const auto* removal = std::get_if<Removal>(&step);
  const bool departs =
      removal && departed_ < departures_.size() && removal->departure == departures_[departed_]->serial;
  if (!departs) return sweep_->forward(step);
  const Departure& departure = *departures_[departed_];
  const Eigen::Index begin = chunks_.front()->size, column = rowsOf(departed_++);
  const auto X = sweep_->X(); // d = e - [m]x xi_R
  auto leaving = leaving_.middleCols<3>(column).topRows(X.rows());
  leaving = X.middleCols<3>(removal->row);
  addTurned(X.middleCols<3>(kRotation), so3::hat(departure.inactive.landmark.position), leaving);
  leaving_.block<3, 3>(begin + column, column) = departure.inactive.covariance;
  sweep_->forward(step);
  sweep_->append(departure.cross);
}

Stretch Composition::stretch(MatrixStore& store) const {
  const Eigen::Index begin = chunks_.front()->size, left = rowsOf(departures_.size());
  const auto X = sweep_->X();
  const auto gram = sweep_->gram();
  const auto keep = [&store](const PooledMatrix& matrix) { return store.keep(matrix); };
  const auto keepSymmetric = [&store](PooledMatrix lower) {
    mirrorLower(lower);
    return store.keep(lower);
  };
  PooledVector<Landmark> landmarks;
  PooledVector<std::uint64_t> serials;
  for (std::size_t i = 0; i < departures_.size(); ++i) {
    landmarks.push_back(departures_[i]->inactive.landmark);
    landmarks.back().position += sweep_->learned().segment<3>(begin + rowsOf(i));
    serials.push_back(departures_[i]->serial);
  }
  return {
      keep(X.topRows(begin).transpose()),
      keepSymmetric(gram.topLeftCorner(begin, begin)),
      sweep_->learned().head(begin),
      std::move(landmarks),
      std::move(serials),
      keepSymmetric(leaving_.bottomLeftCorner(left, left).transpose() - gram.bottomRightCorner(left, left)),
      keep(X.bottomRows(left).transpose()),
      keep(leaving_.topLeftCorner(begin, left).transpose() - gram.bottomLeftCorner(left, begin))};
}

} // namespace vi_ekf_slam::invariant
