// The relative error of the baseline as a variable of the state: velocity and stereo tell it.

#include <cmath>
#include <random>

#include "../filter/states.hpp"

namespace vi_ekf_slam::test {
namespace {

/// A body that drives by points at 8 m/s, sees them with a pair whose baseline is (1 + error) of what the rig
/// says, and measures its velocity at 10 Hz.
class ScaleDrive {
 public:
  ScaleDrive(unsigned seed, double error, double scale_sigma)
      : engine_(seed), error_(error), random_(seed), scene_(start(scale_sigma)) {}

  void drive(int frames) {
    for (int i = 0; i < frames; ++i) {
      scene_.motion.propagate(scene_.filter, 0.1);
      truth_ = (truth_ * SE3::Exp(0.1 * twist_)).normalized();
      VelocitySample velocity;
      velocity.linear_velocity = twist_.head<3>() + normal(0.1);
      velocity.covariance = isotropic(0.1);
      ImuSample gyro;
      gyro.angular_velocity = twist_.tail<3>() + normal(0.002);
      gyro.covariance = isotropic(0.002);
      scene_.filter.correct(scene_.motion.measure(scene_.filter, velocity));
      scene_.motion.process(scene_.filter, gyro);
      scene_.filter.settle();
      frame();
    }
  }

  double scale() const { return scene_.filter.variables().mean(*scene_.scale)[0]; }
  double sigma() const { return std::sqrt(scene_.filter.covariance(*scene_.scale)(0, 0)); }
  const Scene& scene() const { return scene_; }

 private:
  struct Tracked {
    Handle variable;
    Eigen::Vector3d truth;
  };

  static Scene start(double scale_sigma) {
    ConstantTwist::Options options;
    options.prior_bias_sigma.setConstant(1e-3);
    options.prior_twist_sigma << 15.0, 1.0, 1.0, 0.3, 0.3, 0.5;
    Scene scene{Filter(SE3(), 1e-6 * Matrix6d::Identity()), ConstantTwist(options), {}, {}};
    scene.motion.addTo(scene.filter);
    RigVariables::Options rig;
    rig.scale_sigma = scale_sigma;
    RigVariables::addTo(scene.filter, rig);
    scene.scale = scene.filter.variables().find("scale");
    scene.filter.closeCore();
    return scene;
  }

  Eigen::Vector3d normal(double sigma) {
    std::normal_distribution<double> draw(0.0, sigma);
    return {draw(engine_), draw(engine_), draw(engine_)};
  }

  StereoPixels pixelsOf(const Eigen::Vector3d& point) {
    StereoCamera camera = exampleRig().camera;
    camera.baseline *= 1.0 + error_;
    StereoPixels z = camera.project(exampleRig().cam_T_imu * truth_.inverse() * point);
    std::normal_distribution<double> draw(0.0, 0.7);
    for (int i = 0; i < 4; ++i) z[i] += draw(engine_);
    return z;
  }

  void frame() {
    const SE3 cam_T_world = exampleRig().cam_T_imu * truth_.inverse();
    std::vector<LinearMeasurement> all;
    for (std::size_t i = tracked_.size(); i-- > 0;) {
      const bool in_view = (cam_T_world * tracked_[i].truth).z() > 3.0;
      const auto z =
          in_view ? scene_.model().observe(scene_.filter, tracked_[i].variable, pixelsOf(tracked_[i].truth))
                  : std::nullopt;
      if (z) {
        all.push_back(*z);
        continue;
      }
      scene_.filter.remove(tracked_[i].variable);
      tracked_.erase(tracked_.begin() + static_cast<std::ptrdiff_t>(i));
      all.clear();
      i = tracked_.size(); // rows have changed: once more
    }
    if (!all.empty()) correctSeen(scene_.filter, all, scene_.model());
    while (tracked_.size() < 20) {
      const Eigen::Vector3d q(random_.uniform(-6.0, 6.0), random_.uniform(-2.0, 2.0),
                              random_.uniform(6.0, 25.0));
      const Eigen::Vector3d point = cam_T_world.inverse() * q;
      const auto found = scene_.model().triangulate(scene_.filter, pixelsOf(point));
      if (!found) continue;
      tracked_.push_back(
          {scene_.filter.augment(Chart::kPoint, found->position, found->noise, found->by), point});
    }
  }

  std::mt19937 engine_;
  double error_;
  Random random_;
  Scene scene_;
  SE3 truth_;
  Vector6d twist_ = (Vector6d() << 8.0, 0.0, 0.0, 0.0, 0.0, 0.05).finished();
  std::vector<Tracked> tracked_;
};

TEST(StereoScale, IsFoundFromVelocityAndStereoWithinItsSigma) {
  double squared = 0.0;
  int runs = 0;
  for (const double error : {0.03, -0.03, 0.0}) {
    for (unsigned seed = 1; seed <= 4; ++seed) {
      ScaleDrive drive(seed, error, 0.02);
      drive.drive(100);
      EXPECT_LT(drive.sigma(), 0.005);
      EXPECT_LT(std::abs(drive.scale() - error), 4.0 * drive.sigma()) << error << " " << seed;
      squared += std::pow((drive.scale() - error) / drive.sigma(), 2);
      ++runs;
    }
  }
  EXPECT_LT(squared / runs, 2.0);
}

TEST(StereoScale, IsNotToldByStereoAlone) {
  // Nothing but the pixels: any scale of the whole world fits them. What is told all the same is of second
  // order, where noise moves the points at which the derivatives are taken.
  for (const double noise : {0.0, 1.0}) {
    Random random(5);
    Scene scene = coreScene(random, 0.02);
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector3d q(random.uniform(-4.0, 4.0), random.uniform(-1.0, 2.0),
                              random.uniform(6.0, 20.0));
      const auto found = scene.model().triangulate(scene.filter, exampleRig().camera.project(q));
      ASSERT_TRUE(found);
      scene.points.push_back(scene.filter.augment(Chart::kPoint, found->position, found->noise, found->by));
    }
    for (int frame = 0; frame < 20; ++frame)
      correctSeen(scene.filter, scene.seen(random, noise), scene.model());
    const double sigma = std::sqrt(scene.filter.covariance(*scene.scale)(0, 0));
    EXPECT_GT(sigma, (noise > 0.0 ? 0.98 : 1.0 - 1e-9) * 0.02) << noise;
    RecordProperty("sigma_ppm", static_cast<int>(1e6 * sigma / 0.02));
  }
}

TEST(StereoScale, OfNoSigmaIsNotInTheState) {
  ScaleDrive with(1, 0.0, 0.02), without(1, 0.0, 0.0);
  EXPECT_EQ(with.scene().filter.coreRows(), 19);
  EXPECT_EQ(without.scene().filter.coreRows(), 18);
  without.drive(20);
}

} // namespace
} // namespace vi_ekf_slam::test
