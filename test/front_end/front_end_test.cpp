#include "vi_ekf_slam/front_end/front_end.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "slanted_plane.hpp"

namespace vi_ekf_slam {
namespace {

constexpr Stamp kPeriod = 50'000'000; // ns

/// The camera drifts sideways and ahead, and turns.
SE3 poseAt(int frame) {
  const double t = 0.05 * frame;
  return {so3::Exp({0.05 * t, 0.08 * t, 0.1 * t}), {0.3 * t, -0.1 * t, 0.4 * t}};
}

Stamp stampAt(int frame) { return 1'000'000'000 + frame * kPeriod; }

/// Errors of one run, px.
struct Errors {
  double flow = 0.0, left_right = 0.0; ///< RMS along a track since it began, and of the disparity
  double worst = 0.0;
  std::size_t observations = 0, matched_first = 0, ids = 0, longest = 0;
};

/// `spoil`: what becomes of a pair, of which number.
Errors follow(
    const StereoCalibration& calibration, int frames,
    const std::function<void(StereoImages&, int)>& spoil = [](StereoImages&, int) {}) {
  const SlantedPlane wall(calibration);
  FrontEnd front_end(calibration, {kCount});
  struct Begin {
    Eigen::Vector3d point;
    std::size_t seen;
  };
  std::map<FeatureId, Begin> began;
  Errors errors;
  for (int k = 0; k < frames; ++k) {
    StereoImages images = wall.look(poseAt(k), stampAt(k));
    spoil(images, k);
    const StereoFrame frame = front_end.process(images);
    EXPECT_EQ(stampAt(k), frame.stamp);
    for (const auto& f : frame.features) {
      const auto place = wall.pointAt(poseAt(k), f.pixels.head<2>());
      auto& track = began.try_emplace(f.id, Begin{place, 0}).first->second;
      const StereoPixels flow = f.pixels - calibration.camera.project(poseAt(k).inverse() * track.point);
      const StereoPixels here = f.pixels - calibration.camera.project(poseAt(k).inverse() * place);
      errors.flow += flow.head<2>().squaredNorm() / 2.0;
      errors.left_right += here.tail<2>().squaredNorm() / 2.0;
      errors.worst = std::max(errors.worst, flow.head<2>().norm());
      errors.longest = std::max(errors.longest, ++track.seen);
      ++errors.observations;
    }
    if (k == 0) errors.matched_first = frame.features.size();
  }
  errors.ids = began.size();
  errors.flow = std::sqrt(errors.flow / static_cast<double>(errors.observations));
  errors.left_right = std::sqrt(errors.left_right / static_cast<double>(errors.observations));
  return errors;
}

void expectAccurate(const Errors& errors, int frames) {
  EXPECT_LT(errors.flow, 0.1);
  EXPECT_LT(errors.left_right, 0.1);
  EXPECT_LT(errors.worst, 1.0);
  EXPECT_GT(errors.observations, kCount * static_cast<std::size_t>(frames) * 8 / 10);
  EXPECT_GT(errors.matched_first, kCount * 6 / 10); // a strip is not in the right image
  EXPECT_EQ(errors.longest, static_cast<std::size_t>(frames));
  EXPECT_LT(errors.ids, 3 * kCount); // of which most have left the view
}

TEST(FrontEnd, follows_points_of_rectified_images_to_a_tenth_of_a_pixel) {
  expectAccurate(follow(testCalibration(), 30), 30);
}

TEST(FrontEnd, follows_points_of_raw_images_to_a_tenth_of_a_rectified_pixel) {
  expectAccurate(follow(distortedCalibration(CameraModel::Distortion::kPolynomial), 30), 30);
  expectAccurate(follow(distortedCalibration(CameraModel::Distortion::kEquidistant), 30), 30);
}

TEST(FrontEnd, follows_points_while_each_camera_exposes_for_itself) {
  const auto expose = [](StereoImages& images, int k) {
    images.left = (k % 10 < 5 ? 1.0 : 0.5) * images.left;
    images.right = 0.6 * images.right + 20.0;
  };
  expectAccurate(follow(testCalibration(), 30, expose), 30);
}

// What corners and patches must have at least is in grey levels, of which a dim drive has few.
TEST(FrontEnd, follows_as_many_points_in_a_dim_drive) {
  cv::RNG random(5);
  const auto dim = [&random](StereoImages& images, int) {
    for (cv::Mat* image : {&images.left, &images.right}) {
      cv::Mat noise(image->size(), CV_32F), levels;
      random.fill(noise, cv::RNG::NORMAL, 0.0, 0.7);
      image->convertTo(levels, CV_32F, 0.12);
      cv::Mat(levels + noise).convertTo(*image, CV_8U);
    }
  };
  const Errors errors = follow(testCalibration(), 20, dim);
  EXPECT_GT(errors.observations, kCount * 20 * 8 / 10);
  EXPECT_LT(errors.flow, 0.3);
}

// What a track shows is taken for another thing bit by bit: each picture is like the one before, and not like
// the one in which the track began.
TEST(FrontEnd, states_how_far_new_anchors_lead_a_track_away_and_nothing_while_it_looks_as_it_began) {
  const SlantedPlane wall(testCalibration());
  FrontEnd front_end(testCalibration(), {kCount});
  const auto walks = [](const StereoFrame& frame) {
    std::size_t count = 0;
    for (const auto& f : frame.features) count += f.walk > 0.0 ? 1 : 0;
    return count;
  };
  int k = 0;
  for (; k < 5; ++k) EXPECT_EQ(0u, walks(front_end.process(wall.look(poseAt(k), stampAt(k)))));
  const StereoImages first = wall.look(poseAt(4), stampAt(k));
  cv::Mat noise(first.left.size(), CV_8UC1);
  cv::RNG(3).fill(noise, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(noise, noise, {}, 2.0);
  cv::normalize(noise, noise, 0, 255, cv::NORM_MINMAX);
  std::map<FeatureId, double> strayed; // px^2
  for (double share = 0.1; share < 0.75; share += 0.1, ++k) {
    StereoImages images{stampAt(k), {}, {}};
    cv::addWeighted(first.left, 1.0 - share, noise, share, 0.0, images.left);
    cv::addWeighted(first.right, 1.0 - share, noise, share, 0.0, images.right);
    for (const auto& f : front_end.process(images).features)
      strayed[f.id] += f.walk * f.walk * secondsBetween(stampAt(0), stampAt(1));
  }
  std::size_t renewed = 0;
  for (const auto& [id, square] : strayed) {
    if (square == 0.0) continue;
    ++renewed;
    EXPECT_GE(square, 0.06) << id; // (0.25 px)^2
  }
  EXPECT_GT(renewed, 10u);
}

// A filter has a frame of the pair that was of no use, too: it takes the time from there.
TEST(FrontEnd, states_a_walk_over_the_time_since_the_pair_before_of_whatever_kind) {
  const SlantedPlane wall(testCalibration());
  FrontEnd front_end(testCalibration(), {kCount});
  std::size_t walks = 0;
  for (int k = 0; k < 24; ++k) {
    StereoImages images = wall.look(poseAt(4 * k), stampAt(k));
    if (k % 2 == 1) images.left.setTo(0);
    for (const auto& f : front_end.process(images).features) {
      if (f.walk == 0.0) continue;
      ++walks;
      EXPECT_GT(f.walk * std::sqrt(secondsBetween(stampAt(0), stampAt(1))), 0.249); // px, of a new anchor
    }
  }
  EXPECT_GT(walks, 5u);
}

TEST(FrontEnd, gives_no_id_twice_and_every_feature_a_noise_and_a_descriptor) {
  const SlantedPlane wall(testCalibration());
  FrontEnd front_end(testCalibration(), {kCount});
  std::set<FeatureId> ended, alive;
  for (int k = 0; k < 20; ++k) {
    const StereoFrame frame = front_end.process(wall.look(poseAt(2 * k), stampAt(k)));
    std::set<FeatureId> now;
    for (const auto& f : frame.features) {
      EXPECT_TRUE(now.insert(f.id).second);
      EXPECT_GT(f.sigma, 0.5);
      EXPECT_LT(f.sigma, 1.0);
      EXPECT_EQ(static_cast<double>(static_cast<float>(f.sigma)), f.sigma); // a message holds it as it is
      const double strayed = f.walk * std::sqrt(secondsBetween(stampAt(0), stampAt(1))); // px
      EXPECT_TRUE(strayed == 0.0 || strayed > 0.249) << strayed; // of a new anchor, or of none
      EXPECT_LT(strayed, 0.7);
      EXPECT_EQ(static_cast<double>(static_cast<float>(f.walk)), f.walk);
      EXPECT_TRUE(f.descriptor);
    }
    std::set<FeatureId> tracks;
    for (const Track& track : front_end.tracks()) tracks.insert(track.id);
    for (const FeatureId id : alive) {
      if (tracks.count(id) == 0) ended.insert(id);
    }
    for (const FeatureId id : tracks) EXPECT_EQ(0u, ended.count(id));
    alive = tracks;
  }
  EXPECT_GT(ended.size(), 5u);
}

// A map that was saved is resumed by the ids of its landmarks.
TEST(FrontEnd, gives_none_of_the_ids_of_an_earlier_start) {
  const SlantedPlane wall(testCalibration());
  const auto idsFrom = [&wall](int begin) {
    FrontEnd front_end(testCalibration(), {kCount});
    std::set<FeatureId> ids;
    for (int k = begin; k < begin + 10; ++k) {
      for (const auto& f : front_end.process(wall.look(poseAt(k), stampAt(k))).features) ids.insert(f.id);
    }
    return ids;
  };
  const std::set<FeatureId> first = idsFrom(0), second = idsFrom(10);
  EXPECT_EQ(first, idsFrom(0)) << "the same pictures, the same ids";
  EXPECT_LT(*first.rbegin(), *second.begin());
}

TEST(FrontEnd, says_of_rows_that_do_not_fit_how_much_noise_they_are) {
  const SlantedPlane wall(testCalibration());
  const auto sigmas = [&](bool is_shifted) {
    FrontEnd front_end(testCalibration(), {kCount});
    StereoFrame frame;
    for (int k = 0; k < 10; ++k) {
      StereoImages images = wall.look(poseAt(k), stampAt(k));
      if (is_shifted) { // the right camera hangs 1 px low
        images.right.rowRange(0, 239).clone().copyTo(images.right.rowRange(1, 240));
      }
      frame = front_end.process(images);
    }
    double sum = 0.0;
    for (const auto& f : frame.features) sum += f.sigma * f.sigma;
    return sum / static_cast<double>(frame.features.size());
  };
  // px^2, of each of the two rows; ten residuals beside a prior that counts as five.
  EXPECT_NEAR(0.5 * 10.0 / 15.0, sigmas(true) - sigmas(false), 0.08);
}

TEST(FrontEnd, describes_a_point_alike_from_image_to_image_and_unlike_its_neighbours) {
  const SlantedPlane wall(testCalibration());
  FrontEnd front_end(testCalibration(), {kCount});
  const auto first = front_end.process(wall.look(poseAt(0), stampAt(0))).features;
  std::vector<StereoFeatureObservation> later;
  for (int k = 1; k <= 5; ++k) later = front_end.process(wall.look(poseAt(k), stampAt(k))).features;
  const auto distance = [](const Descriptor& a, const Descriptor& b) {
    int bits = 0;
    for (std::size_t i = 0; i < a.size(); ++i) bits += __builtin_popcount(static_cast<unsigned>(a[i] ^ b[i]));
    return bits;
  };
  double same = 0.0, other = 0.0, pairs = 0.0, others = 0.0;
  std::size_t described_anew = 0;
  for (const auto& a : first) {
    for (const auto& b : later) {
      (a.id == b.id ? same : other) += distance(*a.descriptor, *b.descriptor);
      (a.id == b.id ? pairs : others) += 1.0;
      described_anew += a.id == b.id && *a.descriptor != *b.descriptor ? 1 : 0;
    }
  }
  ASSERT_GT(pairs, 30.0);
  EXPECT_GT(described_anew, 30u); // after a quarter of a second
  EXPECT_LT(same / pairs, 40.0);
  EXPECT_GT(other / others, 100.0);
}

TEST(FrontEnd, is_deterministic_whatever_the_threads) {
  const SlantedPlane wall(testCalibration());
  const auto run = [&](int threads) {
    cv::setNumThreads(threads);
    FrontEnd front_end(testCalibration(), {kCount});
    std::vector<double> all;
    for (int k = 0; k < 8; ++k) {
      for (const auto& f : front_end.process(wall.look(poseAt(k), stampAt(k))).features) {
        all.insert(all.end(),
                   {static_cast<double>(f.id), f.pixels[0], f.pixels[1], f.pixels[2], f.pixels[3], f.sigma});
        for (const auto byte : *f.descriptor) all.push_back(byte);
      }
    }
    return all;
  };
  const auto one = run(1), four = run(4);
  cv::setNumThreads(-1);
  EXPECT_EQ(one, four);
}

TEST(FrontEnd, the_gyro_finds_tracks_after_a_turn_that_flow_alone_cannot_bridge) {
  const SlantedPlane wall(testCalibration());
  const double rate = 3.0; // rad/s about the optical axis' vertical: 45 px in a frame
  const auto turned = [&](int k) {
    return SE3(so3::Exp({0.0, rate * 0.05 * k, 0.0}), Eigen::Vector3d::Zero());
  };
  const Eigen::Matrix3d cam_R_imu = so3::Exp({0.3, -1.2, 0.5});
  const auto followed = [&](bool with_gyro) {
    FrontEnd front_end(testCalibration(), {kCount});
    front_end.setImuRotation(cam_R_imu);
    for (int i = -10; with_gyro && i <= 20; ++i) {
      ImuSample sample;
      sample.stamp = stampAt(0) + i * 10'000'000;
      sample.angular_velocity = cam_R_imu.transpose() * Eigen::Vector3d(0.0, rate, 0.0);
      front_end.addImu(sample);
    }
    front_end.process(wall.look(turned(0), stampAt(0)));
    front_end.process(wall.look(turned(1), stampAt(1)));
    EXPECT_EQ(with_gyro, front_end.report().rotation_known);
    return front_end.report().followed;
  };
  EXPECT_GT(followed(true), 35u); // the others leave the image
  EXPECT_GT(followed(true), 2 * followed(false));
}

// Flow of a texture that is like itself returns from wrong points too.
TEST(FrontEnd, lets_no_track_jump_by_flow_alone_where_no_motion_is_found_and_there_is_no_gyro) {
  const SlantedPlane wall(testCalibration());
  FrontEnd front_end(testCalibration(), {kCount});
  std::map<FeatureId, Eigen::Vector3d> places;
  std::size_t seen = 0, jumped = 0;
  for (int k = 0; k < 20; ++k) {
    const SE3 pose(so3::Exp({0.0, 0.1 * std::sin(0.8 * k), 0.0}), Eigen::Vector3d::Zero());
    for (const auto& f : front_end.process(wall.look(pose, stampAt(k))).features) {
      const Eigen::Vector3d place = wall.pointAt(pose, f.pixels.head<2>());
      const auto [before, is_new] = places.try_emplace(f.id, place);
      if (is_new) continue;
      ++seen;
      const double off =
          (testCalibration().camera.project(pose.inverse() * before->second) - f.pixels).head<2>().norm();
      jumped += off > 5.0 ? 1 : 0;
      before->second = place;
    }
  }
  EXPECT_GT(seen, 500u);
  EXPECT_LT(7 * jumped, seen); // a fifth of those that go on otherwise
}

TEST(FrontEnd, ends_the_tracks_of_what_moves_against_the_others) {
  const SlantedPlane wall(testCalibration());
  FrontEnd front_end(testCalibration(), {kCount});
  std::size_t rejected = 0;
  for (int k = 0; k < 12; ++k) {
    StereoImages images = wall.look(poseAt(k), stampAt(k));
    // A poster that falls in front of both cameras, 8 px a frame.
    const cv::Rect poster(100, 60 + 8 * k, 90, 60);
    for (cv::Mat* image : {&images.left, &images.right}) {
      const cv::Rect there = poster - cv::Point(image == &images.right ? 30 : 0, 0);
      cv::Mat texture(poster.size(), CV_8UC1);
      cv::RNG(3).fill(texture, cv::RNG::UNIFORM, 0, 256);
      cv::GaussianBlur(texture, texture, {}, 2.0);
      cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
      texture.copyTo((*image)(there));
    }
    front_end.process(images);
    rejected += front_end.report().rejected;
  }
  EXPECT_GT(rejected, 10u);
}

// As something near that fills half of the picture while a drive starts.
TEST(FrontEnd, does_not_take_a_board_that_moves_for_the_world_against_the_gyro) {
  const SlantedPlane wall(testCalibration());
  for (const Eigen::Vector3d& velocity : {Eigen::Vector3d(0.0, 0.6, 0.0), Eigen::Vector3d(0.8, 0.0, 0.0)}) {
    FrontEnd front_end(testCalibration(), {kCount});
    front_end.setImuRotation(Eigen::Matrix3d::Identity());
    std::map<FeatureId, int> ages;
    std::size_t on_board = 0, on_wall = 0;
    for (int k = 0; k < 30; ++k) {
      StereoImages images = wall.look(poseAt(k), stampAt(k));
      const SE3 near(Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.0, 0.0, 2.0) - 0.05 * k * velocity);
      const StereoImages board = wall.look(near * poseAt(k), stampAt(k));
      constexpr int kEdge = 176, kDisparity = 30; // px
      const cv::Rect left(kEdge, 0, 320 - kEdge, 240), right(kEdge - kDisparity, 0, 320 - kEdge, 240);
      board.left(left).copyTo(images.left(left));
      board.right(right).copyTo(images.right(right));
      for (const Stamp before : {kPeriod, Stamp(0)}) // a bias of 0.02 rad/s
        front_end.addImu({stampAt(k) - before, {0.07, 0.08, 0.1}, {}});
      for (const auto& f : front_end.process(images).features) {
        if (++ages[f.id] > 3) ++(f.pixels.x() > kEdge ? on_board : on_wall);
      }
    }
    EXPECT_GT(on_wall, 300u) << velocity.transpose();
    EXPECT_LT(10 * on_board, on_wall) << velocity.transpose();
  }
}

} // namespace
} // namespace vi_ekf_slam
