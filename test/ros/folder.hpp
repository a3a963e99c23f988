#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <string>

namespace vi_ekf_slam {

/// A test in a folder of its own, which is gone afterwards.
class InFolder : public testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/vi_ekf_slam_test_XXXXXX";
    ASSERT_NE(nullptr, mkdtemp(name));
    directory_ = name;
  }
  void TearDown() override { std::filesystem::remove_all(directory_); }

  std::string at(const std::string& name) const { return directory_ + "/" + name; }

  std::string directory_;
};

} // namespace vi_ekf_slam
