#include "vi_ekf_slam/core/invariant/kept_matrix.hpp"

#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kPiece = std::size_t{4} << 20; // bytes
constexpr std::size_t kAlignment = 8;                // values: whole cache lines
constexpr std::size_t kMostFree = 16;                // pieces

} // namespace

class MatrixStore::Piece {
 public:
  /// Populated at once: page by page, the faults alone took a twentieth of a drive's time. Not in huge pages:
  /// a virtual machine that gives free ones back to its host takes six times as long to have them again.
  explicit Piece(std::size_t bytes) : bytes_(bytes) {
    int flags = MAP_PRIVATE | MAP_ANONYMOUS;
#ifdef MAP_POPULATE
    flags |= MAP_POPULATE;
#endif
    void* start = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, flags, -1, 0);
    if (start == MAP_FAILED) throw std::bad_alloc();
    first_ = static_cast<double*>(start);
  }
  ~Piece() { munmap(first_, bytes_); }
  Piece(const Piece&) = delete;
  Piece& operator=(const Piece&) = delete;

  /// All of it is free again. Nobody else has it.
  void clear() { taken_ = 0; }
  /// Room for `values`; nothing when there is not enough.
  double* take(std::size_t values) {
    const std::size_t begin = taken_.fetch_add(values);
    return begin + values <= bytes_ / sizeof(double) ? first_ + begin : nullptr;
  }

 private:
  std::size_t bytes_;
  double* first_;
  std::atomic<std::size_t> taken_{0};
};

/// Pieces that nobody needs any more, for those who need one: new pages cost more than what is written on
/// them.
class MatrixStore::Pool {
 public:
  Pool() { free_.reserve(kMostFree); }

  std::unique_ptr<Piece> take() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (free_.empty()) return std::make_unique<Piece>(kPiece);
    std::unique_ptr<Piece> piece = std::move(free_.back());
    free_.pop_back();
    piece->clear();
    return piece;
  }

  void giveBack(std::unique_ptr<Piece> piece) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (free_.size() < kMostFree) free_.push_back(std::move(piece));
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<Piece>> free_;
};

MatrixStore::MatrixStore() : pool_(std::make_shared<Pool>()) {}

KeptMatrix::KeptMatrix(PooledMatrix matrix) : rows_(matrix.rows()), cols_(matrix.cols()) {
  const auto own = makePooled<const PooledMatrix>(std::move(matrix));
  data_ = std::shared_ptr<const double>(own, own->data());
}

std::shared_ptr<MatrixStore::Piece> MatrixStore::pooledPiece() const {
  return {pool_->take().release(),
          [pool = pool_](Piece* piece) { pool->giveBack(std::unique_ptr<Piece>(piece)); }};
}

KeptMatrix MatrixStore::keep(const Eigen::Ref<const Eigen::MatrixXd>& matrix) {
  const auto size = static_cast<std::size_t>(matrix.size());
  const std::size_t values = (size + kAlignment - 1) / kAlignment * kAlignment;
  double* data = piece_ ? piece_->take(values) : nullptr;
  if (!data) {
    const std::size_t bytes = values * sizeof(double);
    piece_ = bytes > kPiece ? std::make_shared<Piece>(bytes) : pooledPiece();
    data = piece_->take(values);
  }
  Eigen::Map<Eigen::MatrixXd>(data, matrix.rows(), matrix.cols()) = matrix;
  return {std::shared_ptr<const double>(piece_, data), matrix.rows(), matrix.cols()};
}

} // namespace vi_ekf_slam::invariant
