/// Offline runner: a bag in, files out. See kRunBagHelp.
#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>

#include "bag_input.hpp"
#ifdef VI_EKF_SLAM_FRONT_END
#include "bag_images.hpp"
#endif
#include "program_options.hpp"
#include "progress.hpp"
#include "run_bag_options.hpp"
#include "vi_ekf_slam/core/run/atomic_file.hpp"
#include "vi_ekf_slam/core/run/calibration_files.hpp"
#include "vi_ekf_slam/core/run/memory.hpp"
#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"
#include "vi_ekf_slam/ros/map_file.hpp"
#include "vi_ekf_slam/ros/node/stop_request.hpp"

namespace vi_ekf_slam {
namespace {

constexpr int kOk = 0;
constexpr int kUsage = 1;
constexpr int kInput = 2;

/// Of the first stream whose most messages were dropped for their stamps.
std::string droppedProblem(const SystemCounts& counts, const MeasurementBuffer::Options& buffer) {
  for (std::size_t i = 0; i < kStreamCount; ++i) {
    const std::uint64_t strays = counts.behind[i] + counts.ahead[i], dropped = counts.late[i] + strays;
    if (dropped <= counts.processed[i]) continue;
    std::string why;
    if (counts.late[i] > 0)
      addProblem(why, "they come more than " + rounded(buffer.max_delay_s) +
                          " s (buffer/max_delay_s) later after their stamps than another stream");
    if (strays > 0)
      addProblem(why, std::to_string(strays) + " have stamps more than " + rounded(buffer.max_jump_s) +
                          " s (buffer/max_jump_s) away from all others");
    return std::string(kSensorNames[i]) + ": " + std::to_string(dropped) + " of " +
           std::to_string(dropped + counts.processed[i]) + " messages were dropped: " + why +
           "; are all stamps of one clock? (check_rig.py tells more)";
  }
  return {};
}

/// What went wrong with the input as a whole, if anything.
std::string inputProblem(const SlamSystem& system, const Intake& intake, const RunWriter& writer) {
  if (const std::string missing = intake.missingInputs(); !missing.empty()) {
    const std::string motion = system.motionText().empty() ? "" : "; motion: " + system.motionText();
    return "no message on " + missing + ", which the estimator needs (see --imu and so on" + motion + ")";
  }
  if (system.needsRig() && !system.hasRig() && system.counts().frames_without_rig > 0) {
    return "features were not used: " + intake.rigAssembler().problem();
  }
  if (const std::string dropped = droppedProblem(system.counts(), system.config().buffer); !dropped.empty())
    return dropped;
  if (const std::string start = system.estimator().startProblem(); !start.empty())
    return "no pose: the estimator did not start: " + start;
  if (writer.empty()) return "no message gave a pose";
  if (const std::string unused = intake.unusedInputs(); !unused.empty())
    return "no message on " + unused + " could be used, which the estimator needs";
  return {};
}

/// Of what was turned away the most frequent, which mostly is the cause of a problem.
std::string chiefOf(const std::map<std::string, std::uint64_t>& turned_away) {
  const auto most = std::max_element(turned_away.begin(), turned_away.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most == turned_away.end()) return {};
  return "; turned away: " + most->first + ": " + std::to_string(most->second);
}

/// A calibration that is refined by what it was estimated from is no better for it.
void warnOfTheSameRecording(const RigVariables::Options& rig, const Eigen::Vector2d& now) {
  if (!rig.known || !rig.isEstimated()) return;
  const Eigen::Vector2d& then = rig.known->recording;
  if (!(then[1] > 0.0 && then[0] < now[1] && now[0] < then[1])) return;
  std::cerr << "run_bag: calibration/file was estimated from stamps that this bag has too: if it is the same "
               "recording, what it tells is counted twice, and the sigmas found are too small"
            << std::endl;
}

/// Names the images of one camera where the bag has none of the other one.
std::string loneImage(const RunBagOptions& options, const BagInput& input) {
  const bool left = input.hasImages(options.left_image), right = input.hasImages(options.right_image);
  if (left == right || input.has(options.topics.features)) return {};
  return "; its images are those of one camera alone: there is no " +
         (left ? options.right_image : options.left_image);
}

void printSummary(const RunBagOptions& options, const RunWriter& writer, const RunSummary& summary,
                  std::size_t landmarks) {
  const SystemCounts& c = summary.counts;
  const char* what = writer.hasFrames() ? " frames" : " gyro samples (no stereo frame was used)";
  std::cout << writer.size() << (writer.empty() ? " poses" : what) << ", " << landmarks << " landmarks, "
            << c.features << " features (" << c.features_used << " used, " << c.features_rejected
            << " rejected, " << c.features_invalid << " invalid)\n";
  for (const auto& [reason, count] : summary.turned_away)
    std::cout << "turned away: " << reason << ": " << count << "\n";
  for (std::size_t i = 0; i < kStreamCount; ++i) {
    const std::uint64_t strays = c.behind[i] + c.ahead[i];
    if (c.late[i] + c.duplicate[i] + c.invalid[i] + strays == 0) continue;
    std::cout << kSensorNames[i] << ": " << c.late[i] << " late, " << c.duplicate[i] << " duplicate, "
              << c.invalid[i] << " invalid, " << c.behind[i] << " behind and " << c.ahead[i]
              << " ahead of all others\n";
  }
  if (c.resets > 0) std::cout << c.resets << " resets, as told above\n";
  const auto earlier = writer.earlierSizes();
  for (std::size_t i = 0; i < earlier.size(); ++i) {
    std::cout << earlier[i] << " poses from before are in " << options.output << "/"
              << RunWriter::kBeforeReset << i + 1 << "\n";
  }
  std::printf("%.1f s of sensor time in %.2f s\n", writer.sensorSeconds(), summary.wall_s);
  std::cout << "results in " << options.output << std::endl;
}

FullConfig configurationOf(const RunBagOptions& options) {
  return options.config.empty() ? FullConfig() : loadFullConfig(options.config);
}

/// Before a launch starts anything: it ends then with what is wrong, and with nothing left behind.
int check(const RunBagOptions& options) {
  SlamSystem system(configurationOf(options).core);
  if (!options.load_map.empty())
    system.loadMap(std::make_shared<const SavedMap>(readMapFile(options.load_map)), options.load_map);
  if (!options.initial_state.empty()) system.begin(readInitialState(options.initial_state));
  if (!options.bag.empty()) BagReader{options.bag};
  if (!options.output.empty()) RunWriter::requireDirectory(options.output);
  if (!options.config.empty()) std::cout << std::filesystem::absolute(options.config).string() << std::endl;
  return kOk;
}

#ifdef VI_EKF_SLAM_FRONT_END
/// The front end between bag and intake, where the bag has images and no features.
std::unique_ptr<BagImages> imagesOf(const RunBagOptions& options, const FullConfig& config, BagInput& input,
                                    Intake& intake) {
  if (!BagImages::isNeeded(options, input)) {
    if (!options.save_features.empty())
      throw BagError(options.bag + ": --save-features needs a bag with " + options.left_image + " and " +
                     options.right_image + " (raw, or with /compressed) and without " +
                     options.topics.features);
    return nullptr;
  }
  auto images = std::make_unique<BagImages>(options, config, input, intake);
  images->onCalibration([&options](const std::string& text) {
    if (!options.quiet) std::cout << "front end: " << text << std::endl;
  });
  return images;
}
#else
/// Stands for what this program was built without.
struct BagImages {
  void finish() {}
  std::string problem() const { return {}; }
  std::map<std::string, std::uint64_t> turnedAway() const { return {}; }
  void print(std::ostream& /*out*/) const {}
};

std::unique_ptr<BagImages> imagesOf(const RunBagOptions& options, const FullConfig& /*config*/,
                                    BagInput& input, Intake& /*intake*/) {
  if (!options.save_features.empty() ||
      (input.hasImages(options.left_image) && !input.has(options.topics.features)))
    throw BagError(options.bag +
                   ": its images need the front end, which this run_bag was built without (OpenCV)");
  return nullptr;
}
#endif

/// A bag on its way through the estimator into files.
class BagRun {
 public:
  explicit BagRun(const RunBagOptions& options)
      : options_(options),
        config_(configurationOf(options)),
        input_(options.bag, options.topics),
        system_(config_.core),
        intake_(system_, config_.ros, options.topics) {}

  int run() {
    prepare();
    RunWriter::requireDirectory(options_.output);
    listen();
    if (input_.has(options_.topics.twist_bias)) system_.awaitBiasPrior();
    images_ = imagesOf(options_, config_, input_, intake_);
    const auto start = std::chrono::steady_clock::now();
    std::string problem = feed();
    auto turned_away = intake_.turnedAway();
    if (images_) turned_away.merge(images_->turnedAway());
    if (problem.empty()) problem = problemOf(turned_away);

    const MapEstimate estimate = system_.estimator().exactMap()();
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
    RunSummary summary(system_);
    summary.input = options_.bag;
    summary.config = options_.config.empty() ? "built-in defaults" : options_.config;
    summary.wall_s = wall.count();
    summary.turned_away = turned_away;
    summary.body = intake_.imuFrame();
    writer_.write(options_.output, summary, estimate);
    warnOfTheSameRecording(config_.core.invariant.rig, writer_.recording());
    const std::string unsaved = saveMap();
    if (problem.empty()) problem = unsaved;
    if (!options_.save_calibration.empty())
      writeFile(options_.save_calibration, writer_.calibrationText(*summary.rig));
    if (isLost())
      warn("the place in " + options_.load_map + " was not found: poses are in a frame of their own");
    if (!options_.quiet && images_) images_->print(std::cout);
    if (!options_.quiet) printSummary(options_, writer_, summary, estimate.landmarks.size());
    if (problem.empty()) return kOk;
    warn(problem);
    return kInput;
  }

 private:
  void say(const std::string& text) const {
    if (!options_.quiet) std::cout << text << std::endl;
  }
  static void warn(const std::string& text) { std::cerr << "run_bag: " << text << std::endl; }

  /// What is to be known before the first measurement.
  void prepare() {
    if (options_.save_map && !system_.estimator().keepsJointMap())
      throw UsageError("--save-map needs estimator: invariant with map.keep: good or all");
    if (!options_.save_calibration.empty() && !config_.core.invariant.rig.isEstimated())
      throw UsageError(
          "--save-calibration needs a configuration whose section calibration has a sigma above 0");
    if (!options_.load_map.empty())
      system_.loadMap(std::make_shared<const SavedMap>(readMapFile(options_.load_map)), options_.load_map);
    system_.onStart([this](const std::string& text) { say(text); });
    if (!system_.motionText().empty()) say("motion: " + system_.motionText());
    system_.onProblem(warn);
    if (!options_.initial_state.empty()) system_.begin(readInitialState(options_.initial_state));
  }

  void listen() {
    system_.onFrame([this](const Output& output) {
      if (output.report.relocalised) {
        warn("relocalised at " + stampText(output.state.stamp));
        writer_.restart(); // earlier poses are in another frame
      }
      writer_.addFrame(output);
    });
    system_.onImu([this](const Output& output) { writer_.addGyro(output); });
    system_.onNoise([this](const StreamNoise& noise) { say("noise: " + toText(noise)); });
    system_.onReset([this](const std::string& reason, const PathEstimate& path) {
      warn("reset: " + reason);
      writer_.restart(path);
    });
    intake_.onProblem(warn);
  }

  /// All of the bag, or what can be read of it. Why it is not all; empty: it is.
  std::string feed() {
    std::string problem;
    Progress progress(!options_.quiet);
    try {
      input_.feed(intake_, [&progress](double share) {
        progress.show(share);
        return !g_stop;
      });
      if (g_stop) problem = "interrupted; what was computed so far is written";
    } catch (const BagError& e) {
      if (intake_.received() == 0) throw; // nothing to write
      problem = e.what();
    }
    if (images_) images_->finish();
    intake_.flush();
    system_.flush();
    progress.finish();
    return problem;
  }

  /// What went wrong with the input, images first.
  std::string problemOf(const std::map<std::string, std::uint64_t>& turned_away) const {
    if (std::string of_images = images_ ? images_->problem() : ""; !of_images.empty()) return of_images;
    const std::string problem = inputProblem(system_, intake_, writer_);
    return problem.empty() ? "" : problem + chiefOf(turned_away) + loneImage(options_, input_);
  }

  /// Whether the place in a loaded map was looked for in vain.
  bool isLost() const { return !options_.load_map.empty() && system_.counts().relocalisations == 0; }

  /// Where it is wanted. Why not; empty: it is saved.
  std::string saveMap() const {
    const auto map = options_.save_map ? system_.estimator().savedMap() : nullptr;
    if (!map) return {};
    const std::string path = options_.output + "/" + kMapFileName;
    std::error_code none;
    if (isLost() && std::filesystem::equivalent(path, options_.load_map, none))
      return "the map of this run was not saved, since " + options_.load_map +
             ", whose place was not found, would be lost (--output another folder)";
    try {
      writeMapFile(path, map(), config_.ros.map_frame);
    } catch (const MapError& e) { // one that cannot be written is no input that cannot be used
      throw std::runtime_error(e.what());
    }
    return {};
  }

  const RunBagOptions& options_;
  FullConfig config_;
  BagInput input_;
  SlamSystem system_;
  Intake intake_;
  RunWriter writer_;
  std::unique_ptr<BagImages> images_; ///< nothing: not needed
};

} // namespace
} // namespace vi_ekf_slam

int main(int argc, char** argv) {
  using namespace vi_ekf_slam;
  keepFreedMemory();
  std::signal(SIGINT, requestStop);
  std::signal(SIGTERM, requestStop);
  try {
    const RunBagOptions options = parseRunBagOptions(argc, argv);
    if (options.help) {
      std::cout << kRunBagHelp;
      return kOk;
    }
    return options.check ? check(options) : BagRun(options).run();
  } catch (const UsageError& e) {
    std::cerr << "run_bag: " << e.what() << "\nTry 'run_bag --help'." << std::endl;
    return kUsage;
  } catch (const BagError& e) {
    std::cerr << "run_bag: " << e.what() << std::endl;
    return kInput;
  } catch (const MapError& e) {
    std::cerr << "run_bag: " << e.what() << std::endl;
    return kInput;
  } catch (const std::exception& e) { // configuration, or an output that cannot be written
    std::cerr << "run_bag: " << e.what() << std::endl;
    return kUsage;
  }
}
