/// The fuzz target without libFuzzer: the corpus, and a fixed number of mutations of it, always the same
/// ones. Any compiler builds it. The address space is limited, so what asks for unbounded memory fails.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

using Input = std::vector<std::uint8_t>;

constexpr int kMutations = 40; // of each input
constexpr std::size_t kMostBytes = 4096;

std::vector<std::filesystem::path> corpus() {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(VI_EKF_SLAM_CORPUS))
    files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

Input contentOf(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// A few bytes changed, doubled or left out.
Input mutated(Input input, std::mt19937& random) {
  const auto below = [&random](std::size_t n) { return static_cast<std::ptrdiff_t>(random() % n); };
  for (std::ptrdiff_t edits = 1 + below(8); edits > 0; --edits) {
    const std::ptrdiff_t at = below(input.size() + 1);
    const std::ptrdiff_t end =
        at + below(std::min<std::size_t>(16, input.size() - static_cast<std::size_t>(at)) + 1);
    const auto kind = below(4);
    if (kind == 0 && end > at) {
      input.erase(input.begin() + at, input.begin() + end);
    } else if (kind == 1 && input.size() < kMostBytes) {
      const Input piece(input.begin() + at, input.begin() + end);
      input.insert(input.begin() + end, piece.begin(), piece.end());
    } else if (static_cast<std::size_t>(at) < input.size()) {
      input[static_cast<std::size_t>(at)] = static_cast<std::uint8_t>(random());
    }
  }
  return input;
}

void limitAddressSpace() {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) // their shadows take terabytes of it
  const rlimit limit{rlim_t(1) << 30, rlim_t(1) << 30};
  ASSERT_EQ(setrlimit(RLIMIT_AS, &limit), 0);
#endif
}

TEST(Fuzz, CorpusAndItsMutationsBreakNoLaw) {
  limitAddressSpace();
  const auto files = corpus();
  ASSERT_GE(files.size(), 3U) << VI_EKF_SLAM_CORPUS;
  std::mt19937 random(1);
  for (const auto& path : files) {
    const Input input = contentOf(path);
    SCOPED_TRACE(path.filename());
    ASSERT_NO_THROW(LLVMFuzzerTestOneInput(input.data(), input.size()));
    for (int i = 0; i < kMutations; ++i) {
      const Input other = mutated(input, random);
      ASSERT_NO_THROW(LLVMFuzzerTestOneInput(other.data(), other.size())) << "mutation " << i;
    }
  }
}

} // namespace
