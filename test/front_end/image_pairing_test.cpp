#include "vi_ekf_slam/front_end/image_pairing.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace vi_ekf_slam {
namespace {

PendingImage at(double seconds) {
  return {fromSeconds(seconds), [] { return cv::Mat(); }};
}

class Pairing : public testing::Test {
 protected:
  std::vector<Stamp> popAll() {
    std::vector<Stamp> stamps; // ms
    while (const auto pair = pairing_.pop()) stamps.push_back(pair->left.stamp / 1'000'000);
    return stamps;
  }
  ImagePairing pairing_{{0.005, 0.2}};
};

TEST_F(Pairing, takes_the_two_images_of_an_exposure_whichever_comes_first) {
  pairing_.expectGyro(false);
  pairing_.addRight(at(1.002));
  pairing_.addLeft(at(1.0));
  pairing_.addLeft(at(1.1));
  pairing_.addLeft(at(1.2));
  pairing_.addRight(at(1.2));
  EXPECT_EQ((std::vector<Stamp>{1000, 1200}), popAll());
  EXPECT_EQ(1u, pairing_.counts().left_alone);
  pairing_.addRight(at(1.15));
  EXPECT_EQ(1u, pairing_.counts().disordered);
}

TEST_F(Pairing, never_pairs_neighbours_for_good_after_one_that_is_lost) {
  for (const double tolerance : {0.03, 0.06, 0.12}) { // s, of pictures that are 0.05 s apart
    ImagePairing pairing({tolerance, 0.2});
    pairing.expectGyro(false);
    std::size_t pairs = 0;
    for (int k = 0; k < 40; ++k) {
      if (k != 10) pairing.addLeft(at(1.0 + 0.05 * k));
      if (k != 20) pairing.addRight(at(1.01 + 0.05 * k));
      for (; const auto pair = pairing.pop(); ++pairs)
        EXPECT_NEAR(0.01, secondsBetween(pair->left.stamp, pair->right.stamp), 1e-9) << k;
    }
    EXPECT_EQ(38u, pairs);
    EXPECT_EQ(1u, pairing.counts().left_alone);
    EXPECT_EQ(1u, pairing.counts().right_alone);
  }
}

TEST_F(Pairing, counts_the_images_of_a_camera_whose_partner_is_silent) {
  for (int i = 0; i < 20; ++i) pairing_.addLeft(at(1.0 + 0.1 * i));
  EXPECT_TRUE(popAll().empty());
  EXPECT_EQ(17u, pairing_.counts().left_alone); // the last 0.2 s may still get one
}

TEST_F(Pairing, turns_away_what_has_no_stamp) {
  pairing_.expectGyro(false);
  for (int i = 0; i < 3; ++i) {
    pairing_.addLeft(at(0.0));
    pairing_.addRight(at(0.0));
  }
  EXPECT_TRUE(popAll().empty());
  EXPECT_EQ(6u, pairing_.counts().without_stamp);
  EXPECT_EQ(0u, pairing_.counts().disordered);
}

TEST_F(Pairing, holds_a_pair_until_the_gyro_has_reported_up_to_it) {
  for (const double t : {1.0, 1.1}) {
    pairing_.addLeft(at(t));
    pairing_.addRight(at(t));
  }
  pairing_.noteGyro(fromSeconds(0.99));
  EXPECT_TRUE(popAll().empty());
  pairing_.noteGyro(fromSeconds(1.005));
  EXPECT_EQ(std::vector<Stamp>{1000}, popAll());
  pairing_.close();
  EXPECT_EQ(std::vector<Stamp>{1100}, popAll());
}

TEST_F(Pairing, does_not_wait_for_a_silent_gyro_for_ever) {
  for (int i = 0; i < 5; ++i) {
    pairing_.addLeft(at(1.0 + 0.1 * i));
    pairing_.addRight(at(1.0 + 0.1 * i));
    if (i < 3) {
      EXPECT_TRUE(popAll().empty());
    }
  }
  EXPECT_EQ(5u, popAll().size()); // after the first that waited in vain none does
  EXPECT_EQ(1u, pairing_.counts().without_gyro);
}

TEST_F(Pairing, one_that_is_held_waits_as_long_and_no_longer) {
  pairing_.expectGyro(false);
  pairing_.hold(true);
  for (int i = 0; i < 5; ++i) {
    pairing_.addLeft(at(1.0 + 0.1 * i));
    pairing_.addRight(at(1.0 + 0.1 * i));
  }
  EXPECT_EQ((std::vector<Stamp>{1000, 1100}), popAll());
  pairing_.hold(false);
  EXPECT_EQ((std::vector<Stamp>{1200, 1300, 1400}), popAll());
}

TEST_F(Pairing, sheds_what_is_older_than_the_newest_pair_and_counts_it) {
  pairing_.expectGyro(false);
  for (int i = 0; i < 3; ++i) {
    pairing_.addLeft(at(1.0 + 0.03 * i));
    pairing_.addRight(at(1.0 + 0.03 * i));
  }
  EXPECT_EQ(fromSeconds(1.06), pairing_.popNewest()->left.stamp);
  EXPECT_FALSE(pairing_.popNewest());
  EXPECT_EQ(2u, pairing_.counts().shed);
}

TEST_F(Pairing, begins_anew_when_time_jumps_back) {
  pairing_.expectGyro(false);
  for (const double t : {5.0, 5.1, 1.0, 1.1}) {
    pairing_.addLeft(at(t));
    pairing_.addRight(at(t));
  }
  EXPECT_EQ((std::vector<Stamp>{5000, 5100, 1000, 1100}), popAll());
}

TEST_F(Pairing, does_not_wait_for_the_gyro_of_a_time_that_was_left) {
  const auto see = [this](double t) {
    pairing_.noteGyro(fromSeconds(t - 0.01));
    pairing_.addLeft(at(t));
    pairing_.addRight(at(t));
  };
  see(5.0);
  EXPECT_TRUE(popAll().empty());
  for (const double t : {1.0, 1.1, 1.2}) see(t); // a bag that is played again
  pairing_.noteGyro(fromSeconds(1.3));
  EXPECT_EQ((std::vector<Stamp>{1000, 1100, 1200}), popAll());
  EXPECT_EQ(1u, pairing_.counts().shed);
  pairing_.addLeft(at(31.25)); // one stamp that is wrong
  pairing_.addRight(at(31.25));
  for (const double t : {1.3, 1.4}) see(t);
  pairing_.noteGyro(fromSeconds(1.5));
  EXPECT_EQ((std::vector<Stamp>{1300, 1400}), popAll());
  EXPECT_EQ(2u, pairing_.counts().shed);
}

} // namespace
} // namespace vi_ekf_slam
