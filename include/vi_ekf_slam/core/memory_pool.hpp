#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <new>
#include <type_traits>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

namespace vi_ekf_slam {

// Memory that goes from frame to frame: what is given back is kept by the thread that does so, up to what it
// has needed at once, for what it takes next. So a filter that has seen a few frames works without asking the
// system for any. With AddressSanitizer or ThreadSanitizer, which could not watch over it, nothing is kept.

constexpr std::size_t kPoolAlignment = 64;                    // bytes: a cache line, and the widest vectors
constexpr std::size_t kLargestPooled = std::size_t{16} << 20; // bytes; what is larger is not kept
constexpr std::size_t kMostPooled = std::size_t{128} << 20;   // in all

/// `bytes` of memory that begins at a multiple of kPoolAlignment. Throws std::bad_alloc.
void* takePooled(std::size_t bytes);
/// What takePooled gave for so many `bytes`, in this thread or another one.
void giveBackPooled(void* memory, std::size_t bytes) noexcept;

/// For containers of the standard library.
template <class T>
struct PoolAllocator {
  using value_type = T;

  PoolAllocator() = default;
  template <class Other>
  PoolAllocator(const PoolAllocator<Other>& /*other*/) {} // NOLINT(google-explicit-constructor): as asked for

  T* allocate(std::size_t count) {
    if (count > static_cast<std::size_t>(-1) / sizeof(T)) throw std::bad_alloc();
    return static_cast<T*>(takePooled(count * sizeof(T)));
  }
  void deallocate(T* memory, std::size_t count) noexcept { giveBackPooled(memory, count * sizeof(T)); }

  friend bool operator==(const PoolAllocator& /*a*/, const PoolAllocator& /*b*/) { return true; }
  friend bool operator!=(const PoolAllocator& /*a*/, const PoolAllocator& /*b*/) { return false; }
};

template <class T, class... Arguments>
std::shared_ptr<T> makePooled(Arguments&&... arguments) {
  return std::allocate_shared<T>(PoolAllocator<std::remove_const_t<T>>(),
                                 std::forward<Arguments>(arguments)...);
}

template <class T>
using PooledVector = std::vector<T, PoolAllocator<T>>;
template <class T>
using PooledDeque = std::deque<T, PoolAllocator<T>>;
template <class Key, class T>
using PooledMap = std::map<Key, T, std::less<Key>, PoolAllocator<std::pair<const Key, T>>>;
template <class Key>
using PooledHashSet = std::unordered_set<Key, std::hash<Key>, std::equal_to<Key>, PoolAllocator<Key>>;
template <class Key, class T>
using PooledHashMap =
    std::unordered_map<Key, T, std::hash<Key>, std::equal_to<Key>, PoolAllocator<std::pair<const Key, T>>>;

} // namespace vi_ekf_slam
