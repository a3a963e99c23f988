#include "vi_ekf_slam/core/invariant/inactive_map.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/symmetric.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kChunkSteps = 64;      // and on, until the next landmark comes
constexpr std::size_t kMostChunkSteps = 256; // where none comes
// Steps are composed faster than they come in, and not so fast that it would be felt.
constexpr double kComposingPace = 1.5;
constexpr double kLeastComposed = 1e9;        // operations: caches are cold at the beginning of each go
constexpr double kShareThatLeaves = 0.5;      // of the active landmarks, for a stretch
constexpr Eigen::Index kSmallestShrunk = 300; // rows
constexpr std::size_t kChunksOfStretch = 8;   // about
constexpr double kAllOfIt = std::numeric_limits<double>::infinity();
constexpr std::uint64_t kDeparturesElsewhere = std::uint64_t{1} << 40; // more than any drive has

/// Makes room for `rows` x `cols`; what is in use stays.
void reserve(Eigen::MatrixXd& matrix, Eigen::Index rows, Eigen::Index cols) {
  if (matrix.rows() < rows || matrix.cols() < cols)
    matrix.conservativeResize(std::max(rows, matrix.rows()), std::max(cols, matrix.cols()));
}

} // namespace

void InactiveMap::record(DeferredStep step, Eigen::Index size) {
  if (auto* update = std::get_if<KalmanUpdate>(&step)) update->Kt = store_.keep(*update->Kt);
  // A stretch takes along all that is active where it begins, so it begins where the fewest are: after those
  // that leave with a frame, before those that come.
  if (open_.steps.size() >= kChunkSteps && std::holds_alternative<Birth>(step)) closeChunk();
  if (open_.steps.empty()) open_.size = size - gainOf(step);
  const double cost = costOf(step);
  journal_bytes_ += bytesOf(step);
  journal_cost_ += cost;
  open_.steps.push_back(std::move(step));
  if (open_.steps.size() == kMostChunkSteps) closeChunk();
  composing_due_ += kComposingPace * cost;
  if (composing_due_ > kLeastComposed) {
    if (!composition_.isEmpty() || endOfStretch() != journal_.end() ||
        journal_bytes_ > most_journal_bytes_ / 2)
      compose(composing_due_);
    composing_due_ = 0.0;
  }
  while (journal_bytes_ > most_journal_bytes_ && !journal_.empty()) composeOnce(kAllOfIt);
}

void InactiveMap::closeChunk() {
  open_.last_serial = last_serial_;
  journal_.push_back(makePooled<const Chunk>(std::move(open_)));
  open_ = Chunk();
  forgetSteps();
}

void InactiveMap::forgetChunk() {
  for (const DeferredStep& step : journal_.front()->steps) {
    journal_bytes_ -= bytesOf(step);
    journal_cost_ -= costOf(step);
  }
  journal_.pop_front();
}

void InactiveMap::adopt(std::vector<Landmark> landmarks, Eigen::MatrixXd covariance, Eigen::MatrixXd cross) {
  InactiveMap adopted(most_journal_bytes_);
  for (const Landmark& landmark : landmarks) {
    if (!adopted.ids_.emplace(landmark.id, ++adopted.last_serial_).second)
      throw std::logic_error("landmark " + std::to_string(landmark.id) + " is held already");
  }
  adopted.settled_->serials.resize(landmarks.size());
  std::iota(adopted.settled_->serials.begin(), adopted.settled_->serials.end(), std::uint64_t{1});
  adopted.last_serial_ += kDeparturesElsewhere;
  adopted.settled_->landmarks = std::move(landmarks);
  adopted.settled_->rows = cross.rows();
  adopted.settled_->covariance = std::move(covariance);
  adopted.settled_->cross = std::move(cross);
  *this = std::move(adopted);
}

std::vector<std::size_t> InactiveMap::settledByAge() const {
  std::vector<std::size_t> order(settled_->landmarks.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [this](std::size_t a, std::size_t b) { return settled_->serials[a] < settled_->serials[b]; });
  return order;
}

/// Steps before the first departure matter to nobody where nothing is settled.
void InactiveMap::forgetSteps() {
  if (settledCount() > 0) return;
  while (!stretches_.empty() && stretches_.front().left() == 0) stretches_.pop_front();
  if (!stretches_.empty()) return;
  const std::uint64_t first = departures_.empty() ? last_serial_ + 1 : departures_.front()->serial;
  if (journal_.empty() || journal_.front()->last_serial >= first) return;
  composition_ = Composition(); // what it has begun with matters to nobody
  while (!journal_.empty() && journal_.front()->last_serial < first) forgetChunk();
}

void InactiveMap::add(const Landmark& landmark, const Eigen::Matrix3d& covariance, Columns3 cross,
                      Eigen::Index row, Eigen::Index size) {
  if (!ids_.emplace(landmark.id, last_serial_ + 1).second)
    throw std::logic_error("landmark " + std::to_string(landmark.id) + " is held already");
  departures_.push_back(
      makePooled<const Departure>(Departure{{landmark, covariance}, std::move(cross), ++last_serial_}));
  record(Removal{row, last_serial_}, size);
}

const Departure* InactiveMap::departureOf(const Removal& removal) const {
  if (departures_.empty() || removal.departure < departures_.front()->serial) return nullptr;
  return departures_[removal.departure - departures_.front()->serial].get();
}

InactiveMap::Settled& InactiveMap::ownSettled() {
  if (settled_.use_count() > 1) {
    settled_ = std::make_shared<Settled>(*settled_);
  } else {
    // The last other owner may have been a copy in another thread: letting go of one more owner here orders
    // what it read before what is written now (use_count() alone orders nothing).
    const std::shared_ptr<Settled> owner = settled_;
  }
  return *settled_;
}

/// The last chunk of the first ones of the journal by which enough have left to make a stretch: half as many
/// as are active. With fewer there would be many stretches, with more a stretch would have much to take
/// along.
PooledDeque<std::shared_ptr<const Chunk>>::const_iterator InactiveMap::endOfStretch() const {
  const auto before = departures_.empty() ? last_serial_ : departures_.front()->serial - 1;
  return std::find_if(journal_.begin(), journal_.end(), [&](const auto& chunk) {
    return chunk->last_serial >=
           before + static_cast<std::uint64_t>(kShareThatLeaves * static_cast<double>(chunk->size) / 3.0);
  });
}

void InactiveMap::beginComposition() {
  const auto enough = endOfStretch();
  const auto end = enough == journal_.end() ? enough : std::next(enough);
  const std::uint64_t last = (*std::prev(end))->last_serial;
  const auto stays = std::find_if(departures_.begin(), departures_.end(),
                                  [last](const auto& departure) { return departure->serial > last; });
  composition_ = Composition({journal_.cbegin(), end}, {departures_.begin(), stays});
}

double InactiveMap::compose(double operations) {
  double cost = 0.0;
  while (cost < operations && !journal_.empty()) cost += composeOnce(operations - cost);
  return cost;
}

/// The journal is not empty.
double InactiveMap::composeOnce(double operations) {
  if (composition_.isEmpty()) beginComposition();
  const double cost = composition_.advance(operations);
  if (composition_.isDone()) endComposition();
  return cost;
}

/// The chunks give way to their stretch, less what was marginalised meanwhile.
void InactiveMap::endComposition() {
  const Composition composition = std::move(composition_);
  composition_ = Composition();
  auto stretch = makePooled<const Stretch>(composition.stretch(composed_));
  const std::uint64_t first = departures_.empty() ? last_serial_ + 1 : departures_.front()->serial;
  const auto left = std::lower_bound(stretch->serials.begin(), stretch->serials.end(), first);
  const auto gone = static_cast<std::size_t>(left - stretch->serials.begin());
  departures_.erase(departures_.begin(), departures_.begin() + (stretch->serials.end() - left));
  stretches_.push_back({std::move(stretch), gone});
  for (std::size_t i = 0; i < composition.chunks().size(); ++i) forgetChunk();
}

void InactiveMap::settle(Eigen::Index size, std::size_t arrivals) {
  if (!open_.steps.empty()) closeChunk();
  compose(kAllOfIt);
  Settled& settled = ownSettled();
  const Eigen::Index old = rowsOf(settled.landmarks.size()), left = rowsOf(ids_.size()) - old;
  reserve(settled.covariance, old + left, old + left);
  reserve(settled.cross, size + rowsOf(arrivals), old + left);
  auto P = settled.covariance.topLeftCorner(old + left, old + left);
  settled.landmarks.resize(settled.landmarks.size() + static_cast<std::size_t>(left / 3));
  settled.serials.resize(settled.landmarks.size());

  // From the time reached to now, as of a stretch; and the d of those that left since, in terms of the errors
  // then.
  Eigen::MatrixXd F = Eigen::MatrixXd::Identity(size, size), information = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd correction = Eigen::VectorXd::Zero(size);
  Eigen::MatrixXd later(0, size);
  Eigen::Index first = old + left; // row of the first of those
  for (; !stretches_.empty(); stretches_.pop_back()) {
    const Stretch& stretch = *stretches_.back().stretch;
    const std::size_t gone = stretches_.back().gone;
    const Eigen::Index own = rowsOf(stretches_.back().left()), here = first - own;
    const auto stretch_F = *stretch.F;
    const auto cross = (*stretch.cross).rightCols(own);
    const Eigen::MatrixXd learned = cross.transpose() * information;
    settled.cross.block(0, here, size, own).noalias() = F * cross;
    P.block(first, here, later.rows(), own).noalias() = later * cross;
    P.block(here, here, own, own) = (*stretch.covariance).bottomRightCorner(own, own);
    P.block(here, here, own, own).noalias() -= learned * cross;
    for (std::size_t i = gone; i < stretch.landmarks.size(); ++i) {
      const std::size_t to = static_cast<std::size_t>(here / 3) + i - gone;
      settled.landmarks[to] = stretch.landmarks[i];
      settled.landmarks[to].position += (*stretch.cross).middleCols<3>(rowsOf(i)).transpose() * correction;
      settled.serials[to] = stretch.serials[i];
    }
    Eigen::MatrixXd all(own + later.rows(), stretch_F.cols());
    all.topRows(own) = (*stretch.origin).bottomRows(own);
    all.topRows(own).noalias() -= learned * stretch_F;
    all.bottomRows(later.rows()).noalias() = later * stretch_F;
    later.swap(all);
    first = here;
    F = (F * stretch_F).eval();
    information = (stretch_F.transpose() * information * stretch_F).eval() + *stretch.information;
    correction = stretch.learned + stretch_F.transpose() * correction;
  }

  if (old > 0) {
    const Eigen::MatrixXd cross = settled.cross.topLeftCorner(settled.rows, old);
    const Eigen::MatrixXd learned = information * cross;
    P.topLeftCorner(old, old).triangularView<Eigen::Lower>() -= cross.transpose() * learned;
    for (std::size_t i = 0; i < static_cast<std::size_t>(old / 3); ++i)
      settled.landmarks[i].position += cross.middleCols<3>(rowsOf(i)).transpose() * correction;
    settled.cross.topLeftCorner(size, old).noalias() = F * cross;
    P.block(old, 0, left, old).noalias() = later * cross;
  }
  mirrorLower(P);
  settled.rows = size;
}

InactiveMap::Taken InactiveMap::take(FeatureId id) {
  Settled& settled = ownSettled();
  const auto found = std::find_if(settled.landmarks.begin(), settled.landmarks.end(),
                                  [id](const Landmark& landmark) { return landmark.id == id; });
  if (found == settled.landmarks.end())
    throw std::out_of_range("landmark " + std::to_string(id) + " is not held");
  const auto index = static_cast<std::size_t>(found - settled.landmarks.begin());
  const Eigen::Index row = rowsOf(index), last = rowsOf(settled.landmarks.size() - 1);
  Taken taken;
  taken.inactive = {*found, settled.covariance.block<3, 3>(row, row)};
  taken.cross = settled.cross.block(0, row, settled.rows, 3);
  taken.others = settled.covariance.block(row, 0, 3, last);
  // As eraseSettled leaves them: the last one in the place of this one.
  if (row != last) taken.others.middleCols<3>(row) = settled.covariance.block<3, 3>(row, last);
  eraseSettled(index);
  ids_.erase(id);
  return taken;
}

void InactiveMap::appendActive(const Eigen::Matrix<double, 3, Eigen::Dynamic>& rows) {
  Settled& settled = ownSettled();
  reserve(settled.cross, settled.rows + 3, rows.cols());
  settled.cross.block(settled.rows, 0, 3, rows.cols()) = rows;
  settled.rows += 3;
}

/// The last one takes its place.
void InactiveMap::eraseSettled(std::size_t index) {
  Settled& settled = ownSettled();
  const Eigen::Index row = rowsOf(index), last = rowsOf(settled.landmarks.size() - 1);
  if (row != last) {
    auto& P = settled.covariance;
    const Eigen::Matrix3d own = P.block<3, 3>(last, last);
    P.block(row, 0, 3, last) = P.block(last, 0, 3, last).eval();
    P.block(0, row, last, 3) = P.block(0, last, last, 3).eval();
    P.block<3, 3>(row, row) = own;
    settled.cross.block(0, row, settled.rows, 3) = settled.cross.block(0, last, settled.rows, 3).eval();
    settled.landmarks[index] = settled.landmarks.back();
    settled.serials[index] = settled.serials.back();
  }
  settled.landmarks.pop_back();
  settled.serials.pop_back();
  // What a return once made large is let go of.
  if (2 * last > settled.covariance.rows() || last < kSmallestShrunk) return;
  settled.covariance.conservativeResize(last, last);
  settled.cross.conservativeResize(settled.rows, last);
}

std::vector<InactiveLandmark> InactiveMap::marginaliseOldest(std::size_t count, Eigen::Index size) {
  std::vector<InactiveLandmark> all = estimates(size, Covariances::kLastSettled);
  // Settled ones first, by their numbers; whoever left since has a greater number.
  const std::size_t settled_before = settled_->landmarks.size();
  std::vector<std::size_t> order = settledByAge();
  order.resize(std::min(order.size(), count));
  std::vector<InactiveLandmark> gone;
  for (const std::size_t i : order) gone.push_back(all[i]);
  auto stretch = stretches_.begin();
  for (std::size_t i = settled_before; i < all.size() && gone.size() < count; ++i) {
    gone.push_back(all[i]);
    while (stretch != stretches_.end() && stretch->left() == 0) ++stretch;
    if (stretch != stretches_.end()) {
      ++stretch->gone;
    } else {
      departures_.pop_front();
    }
  }
  // From behind, so that the one that takes a place is never one that is still to go.
  std::sort(order.rbegin(), order.rend());
  for (const std::size_t i : order) eraseSettled(i);
  for (const InactiveLandmark& landmark : gone) ids_.erase(landmark.landmark.id);
  forgetSteps();
  return gone;
}

std::vector<InactiveLandmark> InactiveMap::estimates(Eigen::Index size, Covariances covariances) const {
  const bool exact = covariances == Covariances::kExact;
  std::vector<InactiveLandmark> result(this->size());
  std::size_t next = result.size();
  CorrectionSweep means(size);
  InformationSweep spreads(exact ? size : 0);
  const auto estimate = [&](const Landmark& landmark, const Eigen::Matrix3d& covariance,
                            const Eigen::Ref<const Columns3::Plain>& cross) {
    InactiveLandmark l{landmark, covariance};
    l.landmark.position += cross.transpose() * means.correction();
    if (exact) {
      const Columns3 informed = spreads.information() * cross;
      l.covariance.noalias() -= cross.transpose() * informed;
    }
    return l;
  };
  const auto goBack = [&](const Chunk& chunk) {
    for (auto step = chunk.steps.rbegin(); step != chunk.steps.rend(); ++step) {
      const auto* removal = std::get_if<Removal>(&*step);
      if (const Departure* departure = removal ? departureOf(*removal) : nullptr)
        result[--next] =
            estimate(departure->inactive.landmark, departure->inactive.covariance, departure->cross);
      means.back(*step);
      if (exact) spreads.back(*step);
    }
  };
  goBack(open_);
  for (auto chunk = journal_.rbegin(); chunk != journal_.rend(); ++chunk) goBack(**chunk);

  const auto estimateOf = [&](const Landmark& landmark, const auto& covariance, const auto& cross,
                              std::size_t i) {
    const Eigen::Index row = rowsOf(i);
    return estimate(landmark, covariance.template block<3, 3>(row, row), cross.template middleCols<3>(row));
  };
  for (auto composed = stretches_.rbegin(); composed != stretches_.rend(); ++composed) {
    const Stretch& stretch = *composed->stretch;
    for (std::size_t i = stretch.landmarks.size(); i-- > composed->gone;)
      result[--next] = estimateOf(stretch.landmarks[i], *stretch.covariance, *stretch.cross, i);
    means.back(*stretch.F, stretch.learned);
    if (exact) spreads.back(*stretch.F, *stretch.information);
  }
  for (std::size_t i = settled_->landmarks.size(); i-- > 0;)
    result[i] =
        estimateOf(settled_->landmarks[i], settled_->covariance, settled_->cross.topRows(settled_->rows), i);
  return result;
}

double InactiveMap::settlingCost(Eigen::Index size) const {
  const auto n = static_cast<double>(size);
  const double settled = 3.0 * static_cast<double>(settled_->landmarks.size());
  const double left = 3.0 * static_cast<double>(ids_.size()) - settled;
  const auto stretches = static_cast<double>(stretches_.size() + journal_.size() / kChunksOfStretch);
  return journal_cost_ - composition_.cost() + n * settled * settled +
         2.0 * n * (n + settled) * (settled + left) + n * left * (n * stretches + left);
}

std::size_t InactiveMap::bytes() const {
  const auto matrix = [](const auto& m) { return static_cast<std::size_t>(m.size()) * sizeof(double); };
  std::size_t total = journal_bytes_ + matrix(settled_->covariance) + matrix(settled_->cross);
  for (const Composed& composed : stretches_) {
    const Stretch& s = *composed.stretch;
    total +=
        matrix(*s.F) + matrix(*s.information) + matrix(*s.covariance) + matrix(*s.cross) + matrix(*s.origin);
  }
  for (const auto& departure : departures_)
    total += sizeof(Departure) + static_cast<std::size_t>(departure->cross.size()) * sizeof(double);
  return total;
}

} // namespace vi_ekf_slam::invariant
