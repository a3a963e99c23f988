#include "vi_ekf_slam/core/run/yaml_section.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <string>

#include "config_errors.hpp"

namespace vi_ekf_slam {
namespace {

using test::errorOf;
using test::expectAll;

TEST(YamlSection, ReadsTruthTextAndWholeNumbers) {
  YamlSection root = YamlSection::root("{flag: true, name: 'a b', count: 12}", "x");
  bool flag = false;
  std::string name;
  std::size_t count = 0;
  root.read("flag", flag);
  root.read("name", name);
  root.read("count", Range::closed(0.0, 20.0), count);
  EXPECT_TRUE(flag);
  EXPECT_EQ(name, "a b");
  EXPECT_EQ(count, 12U);
  EXPECT_NO_THROW(root.finish());
}

TEST(YamlSection, RefusesTruthAndTextOfAnotherKind) {
  YamlSection root = YamlSection::root("{flag: perhaps, name: [a]}", "x.yaml");
  bool flag = false;
  std::string name;
  expectAll(errorOf([&] { root.read("flag", flag); }), {"x.yaml", "flag", "'perhaps'", "true or false"});
  expectAll(errorOf([&] { root.read("name", name); }), {"x.yaml", "name", "'[a]'", "a text"});
}

TEST(YamlSection, AnAbsentKeyKeepsTheDefaultAndIsKnownToFinish) {
  YamlSection root = YamlSection::root("{}", "x");
  double value = 4.0;
  bool flag = true;
  std::string name = "kept";
  Eigen::VectorXd vector = Eigen::VectorXd::Constant(3, 2.0);
  root.read("value", Range::positive(), value);
  root.read("flag", flag);
  root.read("name", name);
  root.read("vector", Range::positive(), vector);
  EXPECT_EQ(value, 4.0);
  EXPECT_TRUE(flag);
  EXPECT_EQ(name, "kept");
  EXPECT_EQ(vector, Eigen::VectorXd::Constant(3, 2.0));
  EXPECT_NO_THROW(root.finish());
}

TEST(YamlSection, FinishNamesWhatNobodyAskedFor) {
  YamlSection root = YamlSection::root("{a: 1, b: 2}", "x.yaml");
  double a = 0.0;
  root.read("a", Range::positive(), a);
  expectAll(errorOf([&] { root.finish(); }), {"x.yaml", "b", "unknown key", "a"});
  root.allow("b");
  EXPECT_NO_THROW(root.finish());
}

TEST(Range, ContainsItsClosedEndsAndNotItsOpenOnes) {
  EXPECT_TRUE(Range::closed(1.0, 2.0).contains(1.0));
  EXPECT_TRUE(Range::closed(1.0, 2.0).contains(2.0));
  EXPECT_FALSE(Range::closed(1.0, 2.0).contains(2.0001));
  EXPECT_FALSE(Range::halfOpen(1.0, 2.0).contains(1.0));
  EXPECT_TRUE(Range::halfOpen(1.0, 2.0).contains(2.0));
  EXPECT_FALSE(Range::positive().contains(0.0));
  EXPECT_TRUE(Range::notNegative().contains(0.0));
  EXPECT_FALSE(Range::notNegative().contains(-1e-300));
  EXPECT_FALSE(Range::notNegative().contains(std::numeric_limits<double>::infinity()));
  EXPECT_FALSE(Range::notNegative().contains(std::numeric_limits<double>::quiet_NaN()));
}

} // namespace
} // namespace vi_ekf_slam
