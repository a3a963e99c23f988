#include <gtest/gtest.h>

#include "vi_ekf_slam/core/run/memory.hpp"

int main(int argc, char** argv) {
  vi_ekf_slam::keepFreedMemory();
  ::testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
