#include "vi_ekf_slam/simulation/npy.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

namespace vi_ekf_slam::simulation {
namespace {

TEST(Npy, FileHasMagicHeaderAndAlignedData) {
  const std::string path = ::testing::TempDir() + "vi_ekf_slam_test.npy";
  writeNpy(path, std::vector<double>{1.0, 2.0, 3.0, 4.0, 5.0, -6.5}, {2, 3});
  std::ifstream in(path, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  ASSERT_GT(bytes.size(), 10u);
  EXPECT_EQ(bytes.substr(0, 8), std::string("\x93NUMPY\x01\x00", 8));
  const std::size_t header =
      static_cast<unsigned char>(bytes[8]) + 256u * static_cast<unsigned char>(bytes[9]);
  EXPECT_EQ((10 + header) % 64, 0u);
  EXPECT_NE(bytes.find("'shape': (2,3,)"), std::string::npos);
  ASSERT_EQ(bytes.size(), 10 + header + 6 * sizeof(double));
  double last = 0.0;
  std::memcpy(&last, bytes.data() + bytes.size() - sizeof(double), sizeof(double));
  EXPECT_EQ(last, -6.5);
  std::remove(path.c_str());
}

TEST(Npy, RefusesAShapeThatDoesNotFit) {
  EXPECT_THROW(writeNpy("unused.npy", std::vector<double>{1.0}, {2}), std::runtime_error);
}

TEST(Npy, NamesAFileThatCannotBeWritten) {
  try {
    writeNpy("/nonexistent/x.npy", std::vector<std::int64_t>{1}, {1});
    FAIL() << "written to a directory that does not exist";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("/nonexistent/x.npy"), std::string::npos);
  }
}

} // namespace
} // namespace vi_ekf_slam::simulation
