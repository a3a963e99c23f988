#include "vi_ekf_slam/core/run/run_records.hpp"

#include <gtest/gtest.h>

#include <sstream>
#include <thread>

namespace vi_ekf_slam {
namespace {

void add(RunRecords& records, std::size_t number) {
  records.add(static_cast<Stamp>(number) * 100000000, std::to_string(number) + std::string(700, ' ') + "\n");
}

/// Numbers of the records, which must be those from `first` on.
std::size_t countFrom(const RunRecords& records, std::size_t first) {
  std::size_t next = first;
  records.forEach([&next](const std::string& text) {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line); ++next) {
      EXPECT_EQ(line.size(), std::to_string(next).size() + 700);
      EXPECT_EQ(std::stoul(line), next);
    }
  });
  return next - first;
}

TEST(RunRecords, ComeBackInOrder) {
  for (const std::size_t size : {0, 1, 370, 371, 372, 373, 374, 375, 1000}) {
    RunRecords records(std::make_shared<TextSpool>());
    for (std::size_t i = 0; i < size; ++i) add(records, i);
    EXPECT_EQ(records.size(), size);
    EXPECT_EQ(records.empty(), size == 0);
    EXPECT_EQ(countFrom(records, 0), size);
    EXPECT_NEAR(records.seconds(), size == 0 ? 0.0 : 0.1 * static_cast<double>(size - 1), 1e-9);
  }
}

TEST(RunRecords, OfSeveralRunsShareASpool) {
  const auto spool = std::make_shared<TextSpool>();
  RunRecords first(spool), second(spool);
  for (std::size_t i = 0; i < 300; ++i) add(first, i);
  first.close();
  for (std::size_t i = 500; i < 1100; ++i) add(second, i);
  EXPECT_EQ(countFrom(first, 0), 300U);
  EXPECT_EQ(countFrom(second, 500), 600U);
}

TEST(RunRecords, CopiesCanBeReadWhileTheOriginalGrows) {
  RunRecords records(std::make_shared<TextSpool>());
  for (std::size_t i = 0; i < 1000; ++i) add(records, i);
  std::thread reader([copy = records] {
    for (int i = 0; i < 20; ++i) EXPECT_EQ(countFrom(copy, 0), 1000U);
  });
  for (std::size_t i = 1000; i < 20000; ++i) add(records, i);
  reader.join();
  EXPECT_EQ(countFrom(records, 0), 20000U);
}

} // namespace
} // namespace vi_ekf_slam
