#include "vi_ekf_slam/core/invariant/inactive_map.hpp"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/symmetric.hpp"
#include "vi_ekf_slam/core/so3.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kChunkSteps = 64;
// Chunks that are composed before the long list of functionals goes through them at once.
constexpr std::size_t kChunksAtOnce = 8;
constexpr std::size_t kMaxJournalBytes = 512u << 20;

/// d = e - [m]x xi_R as functionals of the active errors, `size` of them.
Eigen::MatrixXd worldForm(const Eigen::Vector3d& position, Eigen::Index row, Eigen::Index size) {
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(3, size);
  d.middleCols<3>(row).setIdentity();
  d.middleCols<3>(kRotation) = -so3::hat(position);
  return d;
}

Eigen::Index rowsOf(std::size_t landmarks) { return 3 * static_cast<Eigen::Index>(landmarks); }

/// Makes room for `rows` x `cols`; what is in use stays.
void reserve(Eigen::MatrixXd& matrix, Eigen::Index rows, Eigen::Index cols) {
  if (matrix.rows() < rows || matrix.cols() < cols)
    matrix.conservativeResize(std::max(rows, matrix.rows()), std::max(cols, matrix.cols()));
}

double costOf(const DeferredStep& step) {
  const auto* update = std::get_if<KalmanUpdate>(&step);
  if (!update) return 0.0;
  const auto n = static_cast<double>(update->A.rows()), r = static_cast<double>(update->A.cols());
  return 6.0 * n * n * r + 5.0 * n * r * r;
}

} // namespace

void InactiveMap::record(DeferredStep step, Eigen::Index size) {
  journal_bytes_ += bytesOf(step);
  journal_cost_ += costOf(step);
  largest_ = std::max(largest_, size);
  open_.steps.push_back(std::move(step));
  if (open_.steps.size() < kChunkSteps) return;
  closeChunk();
  if (journal_bytes_ > kMaxJournalBytes) settle(size, 0);
}

void InactiveMap::closeChunk() {
  open_.last_serial = last_serial_;
  journal_.push_back(std::make_shared<const Chunk>(std::move(open_)));
  open_ = Chunk();
  forgetSteps();
}

/// Steps before the first departure matter to nobody where nothing is settled.
void InactiveMap::forgetSteps() {
  const std::uint64_t first = departures_.empty() ? last_serial_ + 1 : departures_.front()->serial;
  while (settledCount() == 0 && !journal_.empty() && journal_.front()->last_serial < first) {
    for (const DeferredStep& step : journal_.front()->steps) {
      journal_bytes_ -= bytesOf(step);
      journal_cost_ -= costOf(step);
    }
    journal_.pop_front();
  }
}

void InactiveMap::add(const Landmark& landmark, const Eigen::Matrix3d& covariance, Columns3 cross,
                      Eigen::Index row, Eigen::Index size) {
  if (!ids_.emplace(landmark.id, last_serial_ + 1).second)
    throw std::logic_error("landmark " + std::to_string(landmark.id) + " is held already");
  departures_.push_back(std::make_shared<const Departure>(
      Departure{{landmark, covariance}, std::move(cross), ++last_serial_}));
  largest_ = std::max(largest_, size + 3);
  record(Removal{row, last_serial_}, size);
}

const InactiveMap::Departure* InactiveMap::departureOf(const Removal& removal) const {
  if (departures_.empty() || removal.departure < departures_.front()->serial) return nullptr;
  return departures_[removal.departure - departures_.front()->serial].get();
}

InactiveMap::Settled& InactiveMap::ownSettled() {
  if (settled_.use_count() > 1) settled_ = std::make_shared<Settled>(*settled_);
  return *settled_;
}

/// Sweeps backward through a chunk. At a departure, with the sweep at the time just after it, calls
/// at_departure(departure), which returns the functionals (of the errors just before it) to go on with.
template <class AtDeparture>
void InactiveMap::goBack(BackwardSweep& sweep, const Chunk& chunk, AtDeparture&& at_departure) const {
  for (auto step = chunk.steps.rbegin(); step != chunk.steps.rend(); ++step) {
    const auto* removal = std::get_if<Removal>(&*step);
    const Departure* departure = removal ? departureOf(*removal) : nullptr;
    if (departure) {
      at_departure(*departure, *removal);
    } else {
      sweep.back(*step);
    }
  }
}

void InactiveMap::settle(Eigen::Index size, std::size_t arrivals) {
  if (!open_.steps.empty()) closeChunk();
  Settled& settled = ownSettled();
  const Eigen::Index old = rowsOf(settled.landmarks.size()), left = rowsOf(departures_.size());
  const Eigen::Index capacity = std::max({largest_, size, settled.rows});

  // Column by column, the last departure first: covariance with the active errors of now, then with the d of those
  // that left later.
  Eigen::MatrixXd columns(size + left, left);
  std::vector<Landmark> landmarks;
  std::vector<std::uint64_t> serials;
  // The active errors of now and the d of those that left, as functionals of the errors at the time reached.
  Eigen::MatrixXd later = Eigen::MatrixXd::Identity(size, size);
  BackwardSweep sweep(size, capacity, true);
  for (std::size_t end = journal_.size(); end > 0;) {
    const std::size_t begin = end > kChunksAtOnce ? end - kChunksAtOnce : 0;
    sweep.startRows();
    const Eigen::Index here = sweep.size(), first = rowsOf(landmarks.size());
    std::vector<Columns3> with_here; // the chunks' departures with the active errors at their end
    for (; end > begin; --end) {
      goBack(sweep, *journal_[end - 1], [&](const Departure& departure, const Removal& removal) {
        const Columns3& c = departure.cross;
        const Eigen::Index column = rowsOf(landmarks.size());
        const Columns3 with = sweep.rows() * c;
        with_here.push_back(with.topRows(here));
        columns.block(later.rows(), column, with.rows() - here, 3) = with.bottomRows(with.rows() - here);
        const Eigen::Matrix<double, 3, Eigen::Dynamic> learned = c.transpose() * sweep.information();
        columns.block<3, 3>(size + column, column) = departure.inactive.covariance - learned * c;
        landmarks.push_back(departure.inactive.landmark);
        landmarks.back().position += c.transpose() * sweep.correction();
        serials.push_back(departure.serial);
        Eigen::MatrixXd d = -learned;
        sweep.back(DeferredStep(removal));
        // `learned` is of the errors after the removal: as the sweep itself, to those before it.
        Eigen::MatrixXd before = worldForm(departure.inactive.landmark.position, removal.row, sweep.size());
        before.leftCols(d.cols()) += d;
        if (removal.row != d.cols()) {
          before.rightCols<3>() += d.middleCols<3>(removal.row);
          before.middleCols<3>(removal.row) -= d.middleCols<3>(removal.row);
        }
        sweep.appendRows(before);
      });
    }
    Eigen::MatrixXd with(here, rowsOf(with_here.size()));
    for (std::size_t i = 0; i < with_here.size(); ++i) with.middleCols<3>(rowsOf(i)) = with_here[i];
    columns.block(0, first, later.rows(), with.cols()).noalias() = later * with;
    const auto rows = sweep.rows();
    Eigen::MatrixXd all(later.rows() + rows.rows() - here, rows.cols());
    all.topRows(later.rows()).noalias() = later * rows.topRows(here);
    all.bottomRows(rows.rows() - here) = rows.bottomRows(rows.rows() - here);
    later.swap(all);
  }

  reserve(settled.covariance, old + left, old + left);
  auto P = settled.covariance.topLeftCorner(old + left, old + left);
  if (old > 0 && !journal_.empty()) {
    const Eigen::MatrixXd cross = settled.cross.topLeftCorner(settled.rows, old);
    const Eigen::MatrixXd learned = sweep.information() * cross;
    P.topLeftCorner(old, old).triangularView<Eigen::Lower>() -= cross.transpose() * learned;
    const Eigen::VectorXd moved = cross.transpose() * sweep.correction();
    for (std::size_t i = 0; i < settled.landmarks.size(); ++i)
      settled.landmarks[i].position += moved.segment<3>(rowsOf(i));
    const Eigen::MatrixXd with = later * cross;
    reserve(settled.cross, size + rowsOf(arrivals), old + left);
    settled.cross.topLeftCorner(size, old) = with.topRows(size);
    // Those that left last come last.
    for (Eigen::Index i = 0; i < left; i += 3)
      P.block(old + left - 3 - i, 0, 3, old) = with.middleRows(size + i, 3);
  } else {
    reserve(settled.cross, size + rowsOf(arrivals), old + left);
  }
  for (Eigen::Index column = 0; column < left; column += 3) {
    const Eigen::Index to = old + left - 3 - column;
    settled.cross.block(0, to, size, 3) = columns.block(0, column, size, 3);
    for (Eigen::Index row = 0; row < column; row += 3)
      P.block<3, 3>(old + left - 3 - row, to) = columns.block<3, 3>(size + row, column);
    const Eigen::Matrix3d own = columns.block<3, 3>(size + column, column);
    P.block<3, 3>(to, to) = 0.5 * (own + own.transpose());
  }
  mirrorLower(P);
  settled.rows = size;
  settled.landmarks.insert(settled.landmarks.end(), landmarks.rbegin(), landmarks.rend());
  settled.serials.insert(settled.serials.end(), serials.rbegin(), serials.rend());
  departures_.clear();
  journal_.clear();
  journal_bytes_ = 0;
  journal_cost_ = 0.0;
  largest_ = size;
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
  largest_ = std::max(largest_, settled.rows);
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
}

std::vector<InactiveLandmark> InactiveMap::marginaliseOldest(std::size_t count, Eigen::Index size) {
  std::vector<InactiveLandmark> all = estimates(size, Covariances::kLastSettled);
  // Settled ones first, by their numbers; whoever left since has a greater number.
  const std::size_t settled_before = settled_->landmarks.size();
  std::vector<std::size_t> order(settled_before);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [this](std::size_t a, std::size_t b) { return settled_->serials[a] < settled_->serials[b]; });
  order.resize(std::min(order.size(), count));
  std::vector<InactiveLandmark> gone;
  for (const std::size_t i : order) gone.push_back(all[i]);
  for (std::size_t i = settled_before; i < all.size() && gone.size() < count; ++i) {
    gone.push_back(all[i]);
    departures_.pop_front();
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
  BackwardSweep sweep(size, std::max({largest_, size, settled_->rows}), exact);
  std::size_t next = result.size();
  const auto at_departure = [&](const Departure& departure, const Removal& removal) {
    InactiveLandmark& estimate = result[--next];
    estimate = departure.inactive;
    const Columns3& c = departure.cross;
    estimate.landmark.position += c.transpose() * sweep.correction();
    if (exact) estimate.covariance -= c.transpose() * sweep.information() * c;
    sweep.back(DeferredStep(removal));
  };
  goBack(sweep, open_, at_departure);
  for (auto chunk = journal_.rbegin(); chunk != journal_.rend(); ++chunk)
    goBack(sweep, **chunk, at_departure);
  for (std::size_t i = 0; i < settled_->landmarks.size(); ++i) {
    const Eigen::Index row = rowsOf(i);
    result[i] = {settled_->landmarks[i], settled_->covariance.block<3, 3>(row, row)};
    const Columns3 c = settled_->cross.block(0, row, settled_->rows, 3);
    result[i].landmark.position += c.transpose() * sweep.correction();
    if (exact) result[i].covariance -= c.transpose() * sweep.information() * c;
  }
  return result;
}

double InactiveMap::settlingCost(Eigen::Index size) const {
  const auto n = static_cast<double>(size);
  const double settled = 3.0 * static_cast<double>(settled_->landmarks.size());
  const double left = 3.0 * static_cast<double>(departures_.size());
  const auto groups = static_cast<double>(journal_.size()) / kChunksAtOnce;
  return journal_cost_ + n * settled * settled + 2.0 * n * (n + settled) * (settled + left) +
         n * left * (n * groups + left);
}

std::size_t InactiveMap::bytes() const {
  const auto matrix = [](const Eigen::MatrixXd& m) {
    return static_cast<std::size_t>(m.size()) * sizeof(double);
  };
  std::size_t total = journal_bytes_ + matrix(settled_->covariance) + matrix(settled_->cross);
  for (const auto& departure : departures_)
    total += sizeof(Departure) + static_cast<std::size_t>(departure->cross.size()) * sizeof(double);
  return total;
}

} // namespace vi_ekf_slam::invariant
