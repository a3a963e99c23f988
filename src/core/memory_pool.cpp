#include "vi_ekf_slam/core/memory_pool.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

namespace vi_ekf_slam {
namespace {

#if defined(__clang__)
constexpr bool kPools = !__has_feature(address_sanitizer) && !__has_feature(thread_sanitizer);
#elif defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kPools = false;
#else
constexpr bool kPools = true;
#endif

/// Blocks come in kPoolAlignment times powers of two: of few sizes, so that it is those that were just used,
/// and are in the cache, that are used again. With four sizes from each power to the next a drive took 3 %
/// longer.
struct Size {
  std::size_t index; ///< among the sizes
  std::size_t bytes;
};

constexpr Size sizeFor(std::size_t bytes) {
  Size size{0, kPoolAlignment};
  while (size.bytes < bytes && size.bytes <= kLargestPooled) size = {size.index + 1, 2 * size.bytes};
  return size;
}
static_assert(sizeFor(0).index == 0 && sizeFor(64).index == 0 && sizeFor(65).index == 1 &&
              sizeFor(65).bytes == 128);
constexpr std::size_t kSizes = sizeFor(kLargestPooled).index + 1;

struct Block {
  Block* next;
};

/// The blocks of one size, in one thread.
struct Shelf {
  Block* first = nullptr;
  std::size_t kept = 0;
  std::size_t in_use = 0; ///< taken less given back; 0 where more came back
  std::size_t most_in_use = 0;
};

// Of this thread. Plain, so that they outlive whatever gives memory back while the thread ends.
thread_local std::array<Shelf, kSizes> shelves{};
thread_local std::size_t pooled = 0; // bytes on them
thread_local bool closed = false;

/// By hand: before glibc 2.38 an aligned block that was freed has no room for another one of its size, so
/// that the heap grows and grows.
void* allocate(std::size_t bytes) {
  if (!kPools) return ::operator new (bytes, std::align_val_t{kPoolAlignment});
  if (bytes > PTRDIFF_MAX - kPoolAlignment) throw std::bad_alloc();
  void* const whole = ::operator new(bytes + kPoolAlignment);
  const std::size_t ahead = kPoolAlignment - reinterpret_cast<std::uintptr_t>(whole) % kPoolAlignment;
  char* const memory = static_cast<char*>(whole) + ahead;
  std::memcpy(memory - sizeof whole, &whole, sizeof whole);
  return memory;
}

void release(void* memory) noexcept {
  if (!kPools) return ::operator delete (memory, std::align_val_t{kPoolAlignment});
  void* whole = nullptr;
  std::memcpy(&whole, static_cast<char*>(memory) - sizeof whole, sizeof whole);
  ::operator delete(whole);
}
static_assert(alignof(std::max_align_t) >= sizeof(void*)); // so that there is room for it

/// Gives all back to the system when the thread ends.
struct AtExit {
  AtExit() = default;
  AtExit(const AtExit&) = delete;
  AtExit& operator=(const AtExit&) = delete;
  ~AtExit() {
    closed = true;
    for (Shelf& shelf : shelves) {
      while (shelf.first) {
        Block* const block = shelf.first;
        shelf.first = block->next;
        release(block);
      }
    }
  }
};

} // namespace

void* takePooled(std::size_t bytes) {
  const Size size = sizeFor(bytes);
  if (!kPools || size.index >= kSizes) return allocate(bytes);
  Shelf& shelf = shelves[size.index];
  void* const memory = shelf.first ? shelf.first : allocate(size.bytes);
  if (shelf.first) {
    shelf.first = shelf.first->next;
    --shelf.kept;
    pooled -= size.bytes;
  }
  shelf.most_in_use = std::max(shelf.most_in_use, ++shelf.in_use);
  return memory;
}

/// Not more is kept than this thread has needed at once: what others took, and leave to this one, it will not
/// need again.
void giveBackPooled(void* memory, std::size_t bytes) noexcept {
  if (!memory) return;
  const Size size = sizeFor(bytes);
  if (!kPools || size.index >= kSizes || closed) return release(memory);
  Shelf& shelf = shelves[size.index];
  if (shelf.in_use > 0) --shelf.in_use;
  if (shelf.in_use + shelf.kept >= shelf.most_in_use || size.bytes > kMostPooled - pooled)
    return release(memory);
  [[maybe_unused]] thread_local AtExit at_exit;
  shelf.first = new (memory) Block{shelf.first};
  ++shelf.kept;
  pooled += size.bytes;
}

} // namespace vi_ekf_slam
