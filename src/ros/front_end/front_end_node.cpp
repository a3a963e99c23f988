#include "vi_ekf_slam/ros/front_end/front_end_node.hpp"

#include <cv_bridge/cv_bridge.h>

#include <boost/make_shared.hpp>
#include <utility>

#include "vi_ekf_slam/core/sensors/words.hpp"
#include "vi_ekf_slam/front_end/track_drawing.hpp"
#include "vi_ekf_slam/ros/node/settings.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::uint32_t kImageQueue = 100;    // messages; the callbacks only hand them on
constexpr std::uint32_t kFeatureQueue = 1000; // messages; a bag may be played fast
constexpr double kIdle = 0.1;                 // s of wall time
constexpr double kWarningPeriod = 5.0;        // s of wall time
constexpr double kEndOfInput = 3.0;           // s of wall time; play_bag ends 5 s after the bag
constexpr double kEndInRosTime = 0.3;         // s of ROS time, which a bag that is paused stops
constexpr const char* kTransport = "image_transport";

} // namespace

FrontEndNode::FrontEndNode(ros::NodeHandle nh, ros::NodeHandle private_nh)
    : nh_(nh),
      config_(readConfiguration(private_nh, {kTransport, kDiagnosticPeriod})),
      intake_(config_, resolvedTopics(nh),
              [this](const StereoFeatureArray& features) {
                features_.publish(boost::make_shared<const StereoFeatureArray>(features));
              }),
      transport_(nh_),
      drawings_(transport_.advertise("front_end/image", 1)),
      features_(nh_.advertise<StereoFeatureArray>("features", kFeatureQueue)),
      diagnostics_(nh_, private_nh, intake_) {
  requireDiagnosticPeriod(private_nh);
  intake_.onPair([this](const StereoImages& images, const FrontEnd& front_end) { draw(images, front_end); });
  intake_.onCalibration([](const std::string& text) { ROS_INFO_STREAM(text); });
  std::string transport = "raw";
  readParameter(private_nh, kTransport, "a string such as raw or compressed", transport);
  subscribe(transport);
  worker_ = std::thread(&FrontEndNode::run, this);
}

FrontEndNode::~FrontEndNode() {
  subscriptions_.shutdown();
  for (image_transport::Subscriber& subscriber : images_) subscriber.shutdown();
  queue_.close();
  if (worker_.joinable()) worker_.join();
}

void FrontEndNode::subscribe(const std::string& transport) {
  subscriptions_.listen<sensor_msgs::CameraInfo>("left/camera_info",
                                                 [this](const auto& m) { intake_.addLeftInfo(m); });
  subscriptions_.listen<sensor_msgs::CameraInfo>("right/camera_info",
                                                 [this](const auto& m) { intake_.addRightInfo(m); });
  subscriptions_.listen<sensor_msgs::Imu>("imu", [this](const auto& m) { intake_.add(m); });
  subscriptions_.listenToTransforms([this](const auto& m, bool is_static, bool /*of_this_process*/) {
    intake_.addTransforms(m, is_static);
  });
  for (const bool is_left : {true, false}) {
    const std::string topic = nh_.resolveName(is_left ? "left/image" : "right/image");
    const auto add = [this, is_left](const auto& message) {
      is_left ? intake_.addLeft(message) : intake_.addRight(message);
    };
    if (transport == "compressed") { // decoded here, and only what is used; needs no plugin
      subscriptions_.listenToPointers<sensor_msgs::CompressedImage>(topic + "/compressed", kImageQueue, add);
    } else {
      const boost::function<void(const sensor_msgs::ImageConstPtr&)> callback =
          [this, add](const sensor_msgs::ImageConstPtr& message) {
            queue_.push([add, message] { add(message); }, {});
          };
      images_.push_back(transport_.subscribe(
          topic, kImageQueue, callback, ros::VoidPtr(),
          image_transport::TransportHints(transport, ros::TransportHints().tcpNoDelay(), nh_)));
    }
  }
}

void FrontEndNode::run() {
  while (!queue_.closed()) {
    const bool has_come = takeIn(kIdle);
    work();
    while (!has_come && hasEnded() && intake_.processWaiting()) continue;
    report();
  }
}

/// Whether something has come.
bool FrontEndNode::takeIn(double wait_s) {
  const auto item = queue_.pop(wait_s);
  if (!item) return false;
  item->work();
  last_input_ = WorkQueue::Clock::now();
  time_of_last_input_ = ros::Time::now();
  return true;
}

/// A bag is over, or the sensors have ended: no gyro comes for which the last pair could wait.
bool FrontEndNode::hasEnded() const {
  return secondsSince(last_input_) >= kEndOfInput &&
         (ros::Time::now() - time_of_last_input_).toSec() >= kEndInRosTime;
}

/// Takes in what has come, then the pairs that are complete, with what comes meanwhile.
void FrontEndNode::work() {
  const bool sheds = config_.ros.max_latency_s > 0.0;
  do {
    while (takeIn(0.0)) continue;
  } while ((sheds ? intake_.processNewest() : intake_.processNext()) && !queue_.closed());
}

void FrontEndNode::draw(const StereoImages& images, const FrontEnd& front_end) {
  diagnostics_.notePair(images.stamp);
  if (drawings_.getNumSubscribers() == 0) return;
  const std_msgs::Header header = conversions::toHeader(images.stamp, intake_.leftFrame());
  drawings_.publish(cv_bridge::CvImage(header, "bgr8", drawTracks(images, front_end)).toImageMsg());
}

void FrontEndNode::report() {
  diagnostics_.reportIfDue();
  if (secondsSince(last_warning_) < kWarningPeriod) return;
  last_warning_ = WorkQueue::Clock::now();
  if (const std::string problem = intake_.problem(); !problem.empty())
    ROS_WARN_STREAM("images are not used: " << problem);
  for (const auto& [reason, count] : intake_.flawed()) {
    if (warned_of_.insert(reason).second) ROS_WARN_STREAM(reason);
  }
  const auto turned_away = intake_.turnedAway();
  if (turned_away == warned_) return;
  warned_ = turned_away;
  std::string text;
  for (const auto& [reason, count] : turned_away) addProblem(text, reason + ": " + std::to_string(count));
  ROS_WARN_STREAM(text);
}

} // namespace vi_ekf_slam
