#include "run_bag_options.hpp"

#include <filesystem>

#include "program_options.hpp"
#include "vi_ekf_slam/ros/map_file.hpp"

namespace vi_ekf_slam {

const char* const kRunBagHelp =
    R"(Usage: run_bag IN.bag --output DIR [options]
       run_bag --check [IN.bag] [--output DIR] [--config FILE] [--load-map FILE] [--initial-state FILE]

Runs the estimator over a bag without a ROS master, as fast as it can, and writes what it finds into DIR (made if
needed): trajectory.tum, dead_reckoning.tum, covariance.csv, trajectory_smoothed.tum and covariance_smoothed.csv (as it
is known at the end), frames.csv, landmarks.csv, summary.yaml.

  --output DIR         where the results go; files of the same names are replaced
  --config FILE        configuration, the same YAML file that the node takes; without it that of config/default.yaml,
                       which is built in
  --initial-state FILE goes on from the state in it (dataset_to_bag.py writes such files); motion: inertial
  --imu TOPIC          sensor_msgs/Imu                                [/imu]
  --velocity TOPIC     geometry_msgs/TwistWithCovarianceStamped       [/velocity]
  --wheel-odometry TOPIC   nav_msgs/Odometry, its twist               [/wheel_odometry]
  --twist-bias TOPIC   geometry_msgs/TwistWithCovarianceStamped: what is known of the sensors' biases [/twist_bias]
  --features TOPIC     vi_ekf_slam/StereoFeatureArray                 [/features]
  --left-image TOPIC, --right-image TOPIC   sensor_msgs/Image, or sensor_msgs/CompressedImage on TOPIC/compressed
                       [/left/image, /right/image]: what the front end makes features of, where the bag has none
  --left-info TOPIC    sensor_msgs/CameraInfo                         [/left/camera_info]
  --right-info TOPIC   sensor_msgs/CameraInfo                         [/right/camera_info]
                       an empty TOPIC: that input is not wanted, and not missed; an empty --velocity alone stands for both
                       velocity and wheel odometry
  --topic-prefix NAME  put before each of the nine names above; the transforms from the IMU to the left camera and
                       to where velocities are of always come from /tf_static (or /tf)
  --save-map           writes DIR/map.bag too: the map with its joint covariance, for --load-map and the node
  --save-calibration FILE  writes the calibration that was estimated (section calibration of the configuration) there too,
                       for calibration/file of the next run's configuration
  --load-map FILE      a map.bag to relocalise in, by ids that return or by looks
  --save-features BAG  writes the features that the front end made, and all other inputs, as a bag that needs no front end
  --check              only looks whether these files and DIR can be used, and prints the configuration's absolute path
  --quiet              errors only
  --help               this text

Exit code: 0 all went well; 1 the command line, the configuration or the output is not usable; 2 the bag or the map
is not usable, or the bag only in part: it cannot be read to its end, or an input that the estimator needs is not in it
(an IMU, and a velocity unless it tells accelerations at 50 Hz or more; features, both camera_infos and the transform
too, unless the configuration is one of dead reckoning). What could be computed is written then.
)";

namespace {

namespace po = boost::program_options;

std::string absolute(const std::string& topic) {
  return topic.empty() || topic.front() == '/' ? topic : "/" + topic;
}

void makeAbsolute(RunBagOptions& options, const std::string& prefix) {
  InputTopics& topics = options.topics;
  std::string stem = absolute(prefix);
  while (!stem.empty() && stem.back() == '/') stem.pop_back();
  for (std::string* topic :
       {&topics.imu, &topics.velocity, &topics.wheel_odometry, &topics.twist_bias, &topics.features,
        &topics.left_info, &topics.right_info, &options.left_image, &options.right_image}) {
    if (!topic->empty()) *topic = stem + absolute(*topic);
  }
}

void requireAll(const RunBagOptions& options) {
  if (options.bag.empty()) throw UsageError("no bag given");
  if (options.output.empty()) throw UsageError("--output is missing");
}

/// Of what is read nothing is written over, but for a map that is gone on with.
void requireOutputsOfTheirOwn(const RunBagOptions& options) {
  const auto differ = [](const std::string& name, const std::string& output, const std::string& input) {
    std::error_code missing;
    if (std::filesystem::equivalent(output, input, missing))
      throw UsageError(name + " would write over " + input + ", which is read, allowed: another file");
  };
  for (const std::string& input : {options.bag, options.config, options.initial_state, options.load_map}) {
    differ("--save-features", options.save_features, input);
    differ("--save-calibration", options.save_calibration, input);
  }
  if (options.save_map) differ("--save-map", options.output + "/" + kMapFileName, options.bag);
}

/// `can_be_made`: the file is written at the end, when there is --output.
void requireFolder(const std::string& name, const std::string& file, const std::string& can_be_made) {
  if (file.empty()) return;
  const std::filesystem::path folder = std::filesystem::absolute(file).parent_path();
  if (std::filesystem::is_directory(folder)) return;
  const auto normal = [](const std::string& path) {
    return std::filesystem::absolute(path + "/.").lexically_normal();
  };
  if (!can_be_made.empty() && normal(folder.string()) == normal(can_be_made)) return;
  throw UsageError(name + " is " + file + ", allowed: a file in a folder that exists; " + folder.string() +
                   " does not");
}

} // namespace

RunBagOptions parseRunBagOptions(int argc, const char* const* argv) {
  RunBagOptions options;
  std::string prefix;
  const auto text = [](std::string& to) { return po::value(&to)->default_value(to); };
  po::options_description known; // kRunBagHelp describes them
  known.add_options()("help,h", po::bool_switch(&options.help))("quiet", po::bool_switch(&options.quiet))(
      "check", po::bool_switch(&options.check))("save-map", po::bool_switch(&options.save_map))(
      "bag", text(options.bag))("config", text(options.config))("initial-state", text(options.initial_state))(
      "output", text(options.output))("load-map", text(options.load_map))(
      "save-calibration", text(options.save_calibration))("topic-prefix", text(prefix))(
      "imu", text(options.topics.imu))("velocity", text(options.topics.velocity))(
      "wheel-odometry", text(options.topics.wheel_odometry))("twist-bias", text(options.topics.twist_bias))(
      "features", text(options.topics.features))("left-info", text(options.topics.left_info))(
      "right-info", text(options.topics.right_info))("left-image", text(options.left_image))(
      "right-image", text(options.right_image))("save-features", text(options.save_features));
  const po::variables_map values = parseOptions(argc, argv, known, "bag");
  if (options.topics.velocity.empty() && values["wheel-odometry"].defaulted())
    options.topics.wheel_odometry.clear();
  if (!options.help && !options.check) requireAll(options);
  requireOutputsOfTheirOwn(options);
  requireFolder("--save-features", options.save_features, "");
  requireFolder("--save-calibration", options.save_calibration, options.output);
  makeAbsolute(options, prefix);
  return options;
}

} // namespace vi_ekf_slam
