#include "vi_ekf_slam/core/run/run_records.hpp"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <thread>

namespace vi_ekf_slam {
namespace {

RunRecord recordOf(std::size_t number) {
  RunRecord record;
  record.stamp = static_cast<Stamp>(number) * 100000000;
  record.pose_covariance[35] = static_cast<double>(number);
  record.report.used = number;
  return record;
}

/// Numbers of the records, which must be those from `first` on.
std::size_t countFrom(const RunRecords& records, std::size_t first) {
  std::size_t next = first;
  records.forEach([&next](const RunRecord& record) {
    EXPECT_EQ(record.report.used, next);
    EXPECT_EQ(record.pose_covariance[35], static_cast<double>(next));
    ++next;
  });
  return next - first;
}

TEST(RunRecords, ComeBackInOrder) {
  for (const std::size_t size : {0, 1, 255, 256, 257, 1000}) {
    RunRecords records(std::make_shared<RecordSpool>());
    for (std::size_t i = 0; i < size; ++i) records.add(recordOf(i));
    EXPECT_EQ(records.size(), size);
    EXPECT_EQ(records.empty(), size == 0);
    EXPECT_EQ(countFrom(records, 0), size);
    EXPECT_NEAR(records.seconds(), size == 0 ? 0.0 : 0.1 * static_cast<double>(size - 1), 1e-9);
  }
}

TEST(RunRecords, OfSeveralRunsShareASpool) {
  const auto spool = std::make_shared<RecordSpool>();
  RunRecords first(spool), second(spool);
  for (std::size_t i = 0; i < 300; ++i) first.add(recordOf(i));
  first.close();
  for (std::size_t i = 500; i < 1100; ++i) second.add(recordOf(i));
  EXPECT_EQ(countFrom(first, 0), 300U);
  EXPECT_EQ(countFrom(second, 500), 600U);
}

TEST(RunRecords, AreLostOnlyWhileTheSpoolCannotBeWritten) {
  namespace fs = std::filesystem;
  char name[] = "/tmp/vi_ekf_slam_records_XXXXXX";
  ASSERT_NE(nullptr, mkdtemp(name));
  const fs::path folder = fs::path(name) / "run";
  std::ofstream(folder) << "in the way";
  RunRecords records(std::make_shared<RecordSpool>(folder.string()));
  for (std::size_t i = 0; i < 256; ++i) records.add(recordOf(i));
  EXPECT_THROW(records.add(recordOf(1000)), std::runtime_error);
  EXPECT_THROW(records.close(), std::runtime_error);
  EXPECT_EQ(countFrom(records, 0), 256U);
  fs::remove(folder);
  for (std::size_t i = 256; i < 600; ++i) records.add(recordOf(i));
  EXPECT_EQ(countFrom(records, 0), 600U);
  EXPECT_TRUE(fs::is_empty(folder)) << "it has no name";
  fs::remove_all(name);
}

TEST(RunRecords, CopiesCanBeReadWhileTheOriginalGrows) {
  RunRecords records(std::make_shared<RecordSpool>());
  for (std::size_t i = 0; i < 1000; ++i) records.add(recordOf(i));
  std::thread reader([copy = records] {
    for (int i = 0; i < 20; ++i) EXPECT_EQ(countFrom(copy, 0), 1000U);
  });
  for (std::size_t i = 1000; i < 20000; ++i) records.add(recordOf(i));
  reader.join();
  EXPECT_EQ(countFrom(records, 0), 20000U);
}

} // namespace
} // namespace vi_ekf_slam
