#include "vi_ekf_slam/core/invariant/kept_matrix.hpp"

#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <new>
#include <utility>

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20; // bytes
constexpr std::size_t kPiece = 2 * kHugePage;
constexpr std::size_t kAlignment = 8; // values: whole cache lines

} // namespace

class MatrixStore::Piece {
 public:
  explicit Piece(std::size_t bytes) : mapped_(bytes + kHugePage), values_(bytes / sizeof(double)) {
    start_ = mmap(nullptr, mapped_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (start_ == MAP_FAILED) throw std::bad_alloc();
    void* aligned = start_;
    std::size_t space = mapped_;
    std::align(kHugePage, bytes, aligned, space);
#ifdef MADV_HUGEPAGE
    madvise(aligned, bytes, MADV_HUGEPAGE); // where it is refused, small pages do
#endif
    first_ = static_cast<double*>(aligned);
  }
  ~Piece() { munmap(start_, mapped_); }
  Piece(const Piece&) = delete;
  Piece& operator=(const Piece&) = delete;

  /// Room for `values`; nothing when there is not enough.
  double* take(std::size_t values) {
    const std::size_t begin = taken_.fetch_add(values);
    return begin + values <= values_ ? first_ + begin : nullptr;
  }

 private:
  std::size_t mapped_, values_;
  void* start_;
  double* first_;
  std::atomic<std::size_t> taken_{0};
};

KeptMatrix::KeptMatrix(Eigen::MatrixXd matrix) : rows_(matrix.rows()), cols_(matrix.cols()) {
  const auto own = std::make_shared<const Eigen::MatrixXd>(std::move(matrix));
  data_ = std::shared_ptr<const double>(own, own->data());
}

KeptMatrix MatrixStore::keep(const KeptMatrix& matrix) {
  const auto size = static_cast<std::size_t>((*matrix).size());
  const std::size_t values = (size + kAlignment - 1) / kAlignment * kAlignment;
  double* data = piece_ ? piece_->take(values) : nullptr;
  if (!data) {
    const std::size_t bytes = (values * sizeof(double) + kHugePage - 1) / kHugePage * kHugePage;
    piece_ = std::make_shared<Piece>(std::max(kPiece, bytes));
    data = piece_->take(values);
  }
  std::copy_n((*matrix).data(), size, data);
  return {std::shared_ptr<const double>(piece_, data), matrix.rows_, matrix.cols_};
}

} // namespace vi_ekf_slam::invariant
