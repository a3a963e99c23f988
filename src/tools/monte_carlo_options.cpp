#include "monte_carlo_options.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <sstream>
#include <thread>
#include <vector>

#include "program_options.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"

namespace vi_ekf_slam {

const char* const kMonteCarloHelp =
    R"(Usage: monte_carlo --config FILE.yaml --output DIR [options]

Runs the configured estimator over simulated drives, one a seed, and tells whether its covariance can be believed:
pose NEES at 25, 50, 75 and 100 % of the drive (error and covariance in right-invariant coordinates, 6 degrees of
freedom), NIS per degree of freedom (of each plausible observation by itself, before the consensus chooses), whether
the variance of the global yaw ever falls before a landmark is seen again, and position errors. Writes seeds.csv (a row
a seed), check_points.csv (a row a seed and check point) and frames.csv (means over the seeds, a row a frame) into DIR,
which is made if needed. The errors of the tracks are white, unless --set drift-position=X --set drift-rotation=Y gives all tracks
a common one that grows with the distance.

  --config FILE        configuration, the same YAML file that the node takes
  --output DIR         where the results go; files of the same names are replaced
  --seeds N            number of drives                                          [50]
  --first-seed N       seeds count up from here                                  [1]
  --motion car         two laps round a block with wrong matches, other cars and stale frames (repaired), or
  --motion process     100 s of white noise on the twist's derivative, white measurement noise, no wrong match: the
                       default filter's own model                                [car]
  --motion inertial    (or handheld) 60 s of a body shaken in a room with a raw IMU, or
  --motion inertial-car  the car with one, both after 3 s at rest. The filter is told motion, densities, biases and scales of the IMU,
                       noise of the pixels, gravity, and that tracks do not slip, whatever FILE says; see docs/accuracy.md
  --start given        it begins with the truth and errors drawn from the covariance that it is given, or
  --start self         by itself; the truth is put into its map by position and heading at its first estimate. Of both the
                       first estimate's NEES and the delay are in starts.csv      [given, with a raw IMU alone]
  --blind-from S --blind-for S   with a raw IMU: frames are without features from S s after the first one, for so long; the
                       NEES of the position at the end of it is in starts.csv
  --disturb-rig ROTATION,TRANSLATION,OFFSET,SCALE   with a raw IMU: the filter is told a rig that is wrong by so much (rad
                       and m from the IMU to the camera, s of the pictures' stamps, 1 of the baseline), in directions
                       drawn by the seed; what is left of it is in rig.csv. FILE's calibration says what is estimated
  --set OPTION=VALUE   an option of the drive ('simulate_drive --help' lists them); may be given often
  --frame-rates LIST   Hz, as in 5,10,30: a study of each pair of rates with a table of them all, rates.csv in DIR and
  --imu-rates LIST     the other files in a folder a pair; a list that is left out has the drive's own rate
  --jobs N             threads; results do not depend on it                      [2, or 1 on one core]
  --check LOW,HIGH     exit with 3 when the mean pose NEES at a check point leaves these bounds
  --plot               draw monte_carlo.png into DIR (plot.py monte_carlo DIR does it afterwards)
  --quiet              errors only
  --help               this text

Exit code: 0 it ran; 1 the command line, the configuration or the output is not usable; 3 see --check.
)";

namespace {

namespace po = boost::program_options;

constexpr double kLongestBlind = 1e6; // s

/// The numbers of a list with commas; nothing where one of them is none.
std::vector<double> numbers(const std::string& text) {
  std::vector<double> all;
  std::istringstream in(text + ",");
  for (std::string word; std::getline(in, word, ',');) {
    char* end = nullptr;
    all.push_back(std::strtod(word.c_str(), &end));
    if (word.empty() || *end != '\0') return {};
  }
  return all;
}

double seconds(const std::string& option, const std::string& text, bool above_0) {
  const std::vector<double> value = numbers(text);
  if (value.size() != 1 || !(above_0 ? value[0] > 0.0 : value[0] >= 0.0) || !(value[0] <= kLongestBlind))
    throw UsageError(option + " is '" + text + "', allowed: " + (above_0 ? "above" : "from") +
                     " 0 up to 1e6 s");
  return value[0];
}

simulation::StudyStart start(const std::string& text) {
  if (text == "given") return simulation::StudyStart::kGiven;
  if (text == "self") return simulation::StudyStart::kSelf;
  throw UsageError("--start is '" + text + "', allowed: given or self");
}

simulation::RigDisturbance disturbance(const std::string& text) {
  const std::vector<double> parts = numbers(text);
  const double most[] = {1.0, 1.0, 0.1, 0.5};
  const auto is_within = [](double part, double limit) { return std::abs(part) <= limit; };
  if (!std::equal(parts.begin(), parts.end(), std::begin(most), std::end(most), is_within))
    throw UsageError("--disturb-rig is '" + text +
                     "', allowed: four numbers with commas, up to 1 rad, 1 m, 0.1 s and 0.5");
  return {parts[0], parts[1], parts[2], parts[3]};
}

std::pair<double, double> bounds(const std::string& text) {
  const std::vector<double> ends = numbers(text);
  if (ends.size() != 2 || !(ends[0] <= ends[1]))
    throw UsageError("--check is '" + text + "', allowed: LOW,HIGH with LOW at most HIGH");
  return {ends[0], ends[1]};
}

/// The numbers of a list with commas, each of them one that the option `name` of a drive may have.
std::vector<double> rates(const std::string& option, const std::string& name, const std::string& text) {
  std::vector<double> all;
  std::istringstream in(text + ",");
  for (std::string word; std::getline(in, word, ',');) {
    simulation::DriveOptions parsed;
    try {
      setDriveOption(parsed, name, word);
    } catch (const std::invalid_argument& e) {
      throw UsageError(option + ": " + e.what());
    }
    all.push_back(name == "frame-rate" ? parsed.frame_rate : parsed.imu_rate);
  }
  return all;
}

void set(simulation::DriveOptions& drive, const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) throw UsageError("--set is '" + assignment + "', allowed: OPTION=VALUE");
  const std::string name = assignment.substr(0, equals);
  if (name == "seed" || name == "motion") throw UsageError("--set " + name + ": it has an option of its own");
  setDriveOption(drive, name, assignment.substr(equals + 1));
}

} // namespace

MonteCarloOptions parseMonteCarloOptions(int argc, const char* const* argv) {
  MonteCarloOptions options;
  options.jobs = std::clamp(std::thread::hardware_concurrency(), 1u, 2u);
  std::string motion = "car";
  std::vector<std::string> assignments;
  std::optional<std::string> start_text;
  std::optional<double> blind_from, blind_for;
  const auto to = [](auto take) { return po::value<std::string>()->notifier(take); };
  po::options_description known; // kMonteCarloHelp describes them
  known.add_options()("help,h", po::bool_switch(&options.help))("plot", po::bool_switch(&options.plot))(
      "quiet", po::bool_switch(&options.quiet))("config", po::value(&options.config))(
      "output", po::value(&options.output))("set", po::value(&assignments))(
      "seeds", to([&](auto v) { options.seeds = wholeNumber("--seeds", v, 1, 1000000); }))(
      "first-seed",
      to([&](auto v) { options.first_seed = wholeNumber("--first-seed", v, 0, 1000000000000); }))(
      "jobs", to([&](auto v) { options.jobs = static_cast<unsigned>(wholeNumber("--jobs", v, 1, 1000)); }))(
      "check", to([&](auto v) { options.check = bounds(v); }))(
      "frame-rates", to([&](auto v) { options.frame_rates = rates("--frame-rates", "frame-rate", v); }))(
      "imu-rates", to([&](auto v) { options.imu_rates = rates("--imu-rates", "imu-rate", v); }))(
      "motion", to([&](auto v) { motion = v == "inertial" ? "handheld" : v; }))(
      "start", to([&](auto v) { start_text = v; }))(
      "blind-from", to([&](auto v) { blind_from = seconds("--blind-from", v, false); }))(
      "blind-for", to([&](auto v) { blind_for = seconds("--blind-for", v, true); }))(
      "disturb-rig", to([&](auto v) { options.study.disturbance = disturbance(v); }));
  parseOptions(argc, argv, known);
  if (options.help) return options;
  if (options.config.empty()) throw UsageError("--config is missing");
  if (options.output.empty()) throw UsageError("--output is missing");
  try {
    simulation::DriveOptions parsed;
    setDriveOption(parsed, "motion", motion);
    options.drive = simulation::studyOptions(parsed.motion);
    for (const std::string& assignment : assignments) set(options.drive, assignment);
    checkDriveOptions(options.drive);
    for (const simulation::DriveOptions& drive : drivesOf(options)) checkDriveOptions(drive);
    if (start_text) options.study.start = start(*start_text);
    if (blind_from.has_value() != blind_for.has_value())
      throw UsageError("--blind-from and --blind-for need each other");
    options.study.blind_from = blind_from.value_or(0.0);
    options.study.blind_for = blind_for.value_or(0.0);
    if ((start_text || blind_from || !options.study.disturbance.isNone()) && !options.drive.hasRawImu())
      throw UsageError(
          "--start, --blind-from, --blind-for and --disturb-rig need --motion inertial or inertial-car");
    const double seen = options.drive.duration;
    if (blind_from && seen > 0.0 && *blind_from + *blind_for > seen)
      throw UsageError("--blind-from and --blind-for end after the drive, allowed: up to its duration");
  } catch (const std::invalid_argument& e) {
    throw UsageError(e.what());
  }
  if (options.plot && options.comparesRates())
    throw UsageError(
        "--plot draws one study; plot.py monte_carlo draws each folder of a comparison of rates");
  return options;
}

std::vector<simulation::DriveOptions> drivesOf(const MonteCarloOptions& options) {
  const auto listed = [](const std::vector<double>& rates, double own) {
    return rates.empty() ? std::vector<double>{own} : rates;
  };
  std::vector<simulation::DriveOptions> drives;
  for (const double frame_rate : listed(options.frame_rates, options.drive.frame_rate)) {
    for (const double imu_rate : listed(options.imu_rates, options.drive.imu_rate)) {
      drives.push_back(options.drive);
      drives.back().frame_rate = frame_rate;
      drives.back().imu_rate = imu_rate;
    }
  }
  return drives;
}

} // namespace vi_ekf_slam
