#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "monte_carlo_options.hpp"
#include "monte_carlo_report.hpp"
#include "program_options.hpp"

namespace vi_ekf_slam {
namespace {

using simulation::MotionModel;
using simulation::SeedResult;

MonteCarloOptions parse(std::vector<const char*> words) {
  words.insert(words.begin(), {"monte_carlo", "--config", "c.yaml", "--output", "d"});
  return parseMonteCarloOptions(static_cast<int>(words.size()), words.data());
}

/// A drive of 101 frames whose pose NEES is `nees`.
SeedResult driveOf(double nees) {
  SeedResult result;
  result.frames.resize(101);
  for (simulation::FrameErrors& frame : result.frames) frame.nees.pose = nees;
  return result;
}

TEST(ProgramOptions, AnEmptyValueMayFollowTheEqualSign) {
  std::string topic = "/imu", config;
  boost::program_options::options_description known;
  known.add_options()("imu", boost::program_options::value(&topic))("config",
                                                                    boost::program_options::value(&config));
  const std::vector<const char*> words = {"run_bag", "--imu=", "--config=a=b="};
  parseOptions(static_cast<int>(words.size()), words.data(), known);
  EXPECT_EQ(topic, "");
  EXPECT_EQ(config, "a=b=");
}

TEST(MonteCarloOptions, AreTakenInEitherForm) {
  const MonteCarloOptions options =
      parse({"--seeds", "7", "--first-seed=3", "--motion", "process", "--set", "duration=12", "--set=speed=5",
             "--jobs", "3", "--check", "5.08,7", "--plot"});
  EXPECT_EQ(options.config, "c.yaml");
  EXPECT_EQ(options.output, "d");
  EXPECT_EQ(options.seeds, 7u);
  EXPECT_EQ(options.first_seed, 3u);
  EXPECT_EQ(options.jobs, 3u);
  EXPECT_EQ(options.drive.motion, MotionModel::kProcessModel);
  EXPECT_EQ(options.drive.duration, 12.0);
  EXPECT_EQ(options.drive.speed, 5.0);
  ASSERT_TRUE(options.check.has_value());
  EXPECT_EQ(options.check->first, 5.08);
  EXPECT_EQ(options.check->second, 7.0);
  EXPECT_TRUE(options.plot);
}

TEST(MonteCarloOptions, MotionComesBeforeWhatIsSetWhateverTheOrder) {
  EXPECT_EQ(parse({"--set", "duration=12", "--motion", "process"}).drive.duration, 12.0);
  EXPECT_EQ(parse({"--motion", "process"}).drive.outlier_fraction, 0.0);
  EXPECT_EQ(parse({}).drive.motion, MotionModel::kCarDrive);
  EXPECT_GT(parse({}).drive.outlier_fraction, 0.0);
}

TEST(MonteCarloOptions, RatesArePaired) {
  const MonteCarloOptions options = parse({"--frame-rates", "5,30", "--imu-rates", "10,100,400"});
  const std::vector<simulation::DriveOptions> drives = drivesOf(options);
  ASSERT_EQ(drives.size(), 6u);
  EXPECT_EQ(drives[0].frame_rate, 5.0);
  EXPECT_EQ(drives[0].imu_rate, 10.0);
  EXPECT_EQ(drives[5].frame_rate, 30.0);
  EXPECT_EQ(drives[5].imu_rate, 400.0);
  const auto one_list = drivesOf(parse({"--imu-rates=100", "--set", "frame-rate=20"}));
  ASSERT_EQ(one_list.size(), 1u);
  EXPECT_EQ(one_list[0].frame_rate, 20.0);
  EXPECT_EQ(one_list[0].imu_rate, 100.0);
  EXPECT_EQ(drivesOf(parse({"--set", "frame-rate=20"})).size(), 1u);
  EXPECT_EQ(drivesOf(parse({"--frame-rates", "1,2", "--set", "stale-fraction=0"})).size(), 2u);
}

TEST(MonteCarloOptions, RefuseWhatCannotBe) {
  const std::vector<std::vector<const char*>> refused = {
      {"--seeds", "0"},
      {"--seeds", "-1"},
      {"--seeds", "x"},
      {"--seeds"},
      {"--jobs", "0"},
      {"--motion", "boat"},
      {"--set", "speed"},
      {"--set", "speed=fast"},
      {"--set", "seed=3"},
      {"--set", "colour=red"},
      {"--check", "7"},
      {"--check", "7,5"},
      {"--check", "5,7x"},
      {"--check", ","},
      {"--frame-rates", ""},
      {"--frame-rates", "5,"},
      {"--frame-rates", "5,x"},
      {"--frame-rates", "0"},
      {"--frame-rates", "1,2"}, // nearly all frames would be stale
      {"--imu-rates", "10,0.1"},
      {"--imu-rates", "10", "--plot"},
      {"--start", "self"},
      {"--motion", "inertial", "--start", "alone"},
      {"--motion", "inertial", "--blind-from", "5"},
      {"--motion", "inertial", "--blind-for", "5"},
      {"--motion", "inertial", "--blind-from", "5", "--blind-for", "0"},
      {"--motion", "inertial", "--blind-from", "x", "--blind-for", "5"},
      {"--motion", "inertial", "--blind-from", "31", "--blind-for", "30"},
      {"--blind-from", "5", "--blind-for", "5"},
      {"--nothing", "1"},
      {"stray"},
      {"--motion", "process", "--set", "ids-return=true"}};
  for (const auto& words : refused) EXPECT_THROW(parse(words), UsageError) << words.front();
  const char* bare[] = {"monte_carlo", "--output", "d"};
  EXPECT_THROW(parseMonteCarloOptions(3, bare), UsageError);
}

TEST(MonteCarloOptions, ARawImuHasAStartAndABlindTime) {
  const MonteCarloOptions options =
      parse({"--motion", "inertial", "--start=self", "--blind-from", "10", "--blind-for=30"});
  EXPECT_EQ(options.drive.motion, MotionModel::kHandheld);
  EXPECT_EQ(options.study.start, simulation::StudyStart::kSelf);
  EXPECT_EQ(options.study.blind_from, 10.0);
  EXPECT_EQ(options.study.blind_for, 30.0);
  EXPECT_EQ(parse({"--motion", "inertial-car"}).study.start, simulation::StudyStart::kGiven);
  EXPECT_EQ(parse({"--motion", "inertial-car"}).study.blind_for, 0.0);
}

TEST(MonteCarloReport, BoundsHoldForTheMeanAtEveryCheckPoint) {
  std::vector<SeedResult> results = {driveOf(4.0), driveOf(8.0)};
  EXPECT_TRUE(neesWithin(results, {5.9, 6.1}));
  EXPECT_FALSE(neesWithin(results, {6.1, 7.0}));
  results[0].frames[50].nees.pose = 20.0; // half way
  EXPECT_FALSE(neesWithin(results, {5.9, 6.1}));
  results[0] = driveOf(4.0);
  results[0].frames[51].nees.pose = 20.0; // no check point
  EXPECT_TRUE(neesWithin(results, {5.9, 6.1}));
  results[0].frames[100].nees.pose = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(neesWithin(results, {0.0, 1e9}));
}

TEST(MonteCarloReport, RatesHaveARowEach) {
  std::vector<RateStudy> studies(2);
  studies[0].drive.frame_rate = 30.0;
  studies[0].drive.imu_rate = 400.0;
  studies[0].results = {driveOf(4.0), driveOf(9.0)};
  studies[1].drive.imu_rate = 0.0; // as the frames
  studies[1].results = {driveOf(7.25), driveOf(7.25)};
  studies[1].results[0].frames[100].nees.pose = 9.25;
  const std::string text = ratesSummary(studies);
  EXPECT_NE(text.find("       30     400       6.50      6.50      6.50      6.50"), std::string::npos)
      << text;
  EXPECT_NE(text.find("       10      10       7.25      7.25      7.25      8.25"), std::string::npos)
      << text;
}

TEST(MonteCarloReport, SaysWhichSeedsEndBeforeTheirDrive) {
  std::vector<RateStudy> studies(1);
  studies[0].results = {driveOf(6.0), driveOf(6.0)};
  EXPECT_EQ(ratesSummary(studies).find("begun anew"), std::string::npos);
  studies[0].results[1].begun_anew = true;
  for (const std::string& text : {monteCarloSummary(studies[0].results), ratesSummary(studies)})
    EXPECT_NE(text.find("begun anew                   1 of 2 seeds"), std::string::npos) << text;
}

TEST(MonteCarloReport, SummaryNamesTheLargestFallAndTheBounds) {
  std::vector<SeedResult> results(50, driveOf(6.0));
  results[7].yaw_fall = 0.25;
  const std::string text = monteCarloSummary(results);
  EXPECT_NE(text.find("falls by 25 %"), std::string::npos) << text;
  EXPECT_NE(text.find("5.08-7.00"), std::string::npos) << text;
}

/// A drive of which nothing is known but when it started.
SeedResult startAfter(double delay, double nees) {
  SeedResult result = driveOf(nees);
  result.inertial.emplace();
  result.inertial->start_delay = delay;
  result.inertial->first_tilt = 1.5 * nees;
  result.node_nees = result.largest_node_nees = nees;
  return result;
}

TEST(MonteCarloReport, WhatNeverStartedIsCountedAndLeftOutOfTheMeans) {
  SeedResult never;
  never.inertial.emplace();
  const std::vector<SeedResult> results = {startAfter(0.5, 4.0), never, startAfter(2.5, 8.0), never};
  EXPECT_TRUE(neesWithin(results, {5.9, 6.1}));
  EXPECT_FALSE(neesWithin({never}, {0.0, 1e9}));
  const std::string text = monteCarloSummary(results);
  EXPECT_NE(text.find("not started at all           50 %, not within 2 s 75 %"), std::string::npos) << text;
  EXPECT_NE(text.find("start delay                  1.50 s, at most 2.50 s"), std::string::npos) << text;
  EXPECT_NE(text.find("tilt 9.00"), std::string::npos) << text;
  EXPECT_NE(text.find("NEES of its nodes 6.000, 8.0 at most"), std::string::npos) << text;
  EXPECT_EQ(text.find("blind time"), std::string::npos) << text;
  EXPECT_EQ(monteCarloSummary({driveOf(6.0)}).find("start delay"), std::string::npos);
}

TEST(MonteCarloReport, SaysOfHowManySeedsTheRigIs) {
  SeedResult whole = startAfter(0.5, 6.0), anew = startAfter(0.5, 6.0);
  whole.inertial->rig.fill({0.1, 0.01, 0.02});
  anew.begun_anew = true;
  const std::string text = monteCarloSummary({whole, anew, anew});
  EXPECT_NE(text.find("begun anew                   2 of 3 seeds"), std::string::npos) << text;
  EXPECT_NE(text.find("the rig that it was told, of 1 of 3 seeds"), std::string::npos) << text;
  EXPECT_EQ(monteCarloSummary({whole}).find("begun anew"), std::string::npos);
}

} // namespace
} // namespace vi_ekf_slam
