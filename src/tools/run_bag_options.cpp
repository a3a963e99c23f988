#include "run_bag_options.hpp"

#include <map>

namespace vi_ekf_slam {

const char* const kRunBagHelp =
    R"(Usage: run_bag IN.bag --output DIR [options]
       run_bag --check [IN.bag] [--config FILE] [--load-map FILE]

Runs the estimator over a bag without a ROS master, as fast as it can, and writes what it finds into DIR (made if
needed): trajectory.tum, dead_reckoning.tum, covariance.csv, frames.csv, landmarks.csv, summary.yaml.

  --output DIR         where the results go; files of the same names are replaced
  --config FILE        configuration, the same YAML file that the node takes; without it that of config/default.yaml,
                       which is built in
  --imu TOPIC          sensor_msgs/Imu                                [/imu]
  --velocity TOPIC     geometry_msgs/TwistWithCovarianceStamped       [/velocity]
  --twist-bias TOPIC   the same: what is known of the sensors' biases [/twist_bias]
  --features TOPIC     vi_ekf_slam/StereoFeatureArray                 [/features]
  --left-info TOPIC    sensor_msgs/CameraInfo                         [/left/camera_info]
  --right-info TOPIC   sensor_msgs/CameraInfo                         [/right/camera_info]
  --topic-prefix NAME  put before each of the six names above; the transform from the IMU to the left camera
                       always comes from /tf_static (or /tf)
  --save-map           writes DIR/map.bag too: the map with its joint covariance, for --load-map and the node
  --load-map FILE      a map.bag to relocalise in, by ids that return
  --check              only looks whether these files can be used, and prints the configuration's absolute path
  --quiet              errors only
  --help               this text

Exit code: 0 all went well; 1 the command line, the configuration or the output is not usable; 2 the bag or the map
is not usable, or the bag only in part: it cannot be read to its end, or an input that the estimator needs is not in it
(IMU and velocity; features, both camera_infos and the transform too, unless the configuration is one of dead
reckoning). What could be computed is written then.
)";

namespace {

std::string absolute(const std::string& topic) {
  return topic.empty() || topic.front() == '/' ? topic : "/" + topic;
}

void makeAbsolute(InputTopics& topics, const std::string& prefix) {
  std::string stem = absolute(prefix);
  while (!stem.empty() && stem.back() == '/') stem.pop_back();
  for (std::string* topic : {&topics.imu, &topics.velocity, &topics.twist_bias, &topics.features,
                             &topics.left_info, &topics.right_info}) {
    *topic = stem + absolute(*topic);
  }
}

void requireAll(const RunBagOptions& options) {
  if (options.bag.empty()) throw UsageError("no bag given");
  if (options.output.empty()) throw UsageError("--output is missing");
}

} // namespace

RunBagOptions parseRunBagOptions(int argc, const char* const* argv) {
  RunBagOptions options;
  std::string prefix;
  const std::map<std::string, std::string*> valued = {{"--config", &options.config},
                                                      {"--output", &options.output},
                                                      {"--load-map", &options.load_map},
                                                      {"--topic-prefix", &prefix},
                                                      {"--imu", &options.topics.imu},
                                                      {"--velocity", &options.topics.velocity},
                                                      {"--twist-bias", &options.topics.twist_bias},
                                                      {"--features", &options.topics.features},
                                                      {"--left-info", &options.topics.left_info},
                                                      {"--right-info", &options.topics.right_info}};
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const std::size_t equals = argument.find('=');
    const auto option = valued.find(argument.substr(0, equals));
    if (argument == "--help" || argument == "-h") {
      options.help = true;
    } else if (argument == "--quiet") {
      options.quiet = true;
    } else if (argument == "--save-map") {
      options.save_map = true;
    } else if (argument == "--check") {
      options.check = true;
    } else if (option != valued.end() && equals != std::string::npos) {
      *option->second = argument.substr(equals + 1);
    } else if (option != valued.end()) {
      if (++i == argc) throw UsageError(argument + " needs a value");
      *option->second = argv[i];
    } else if (!argument.empty() && argument.front() == '-') {
      throw UsageError("unknown option " + argument);
    } else if (!options.bag.empty()) {
      throw UsageError("more than one bag given: " + options.bag + " and " + argument);
    } else {
      options.bag = argument;
    }
  }
  if (!options.help && !options.check) requireAll(options);
  makeAbsolute(options.topics, prefix);
  return options;
}

} // namespace vi_ekf_slam
