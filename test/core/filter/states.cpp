#include "states.hpp"

namespace vi_ekf_slam::test {

Eigen::MatrixXd randomMatrix(Random& random, Eigen::Index rows, Eigen::Index cols) {
  Eigen::MatrixXd A(rows, cols);
  for (Eigen::Index i = 0; i < A.size(); ++i) A(i) = random.uniform(-1.0, 1.0);
  return A;
}

Eigen::MatrixXd randomCovariance(Random& random, Eigen::Index size, double variance) {
  const Eigen::MatrixXd A = randomMatrix(random, size, size);
  return variance * (A * A.transpose() + 0.1 * Eigen::MatrixXd::Identity(size, size));
}

ConstantTwist::Options noisyMotion() {
  ConstantTwist::Options options;
  options.twist_density << 0.5, 0.1, 0.2, 0.05, 0.06, 0.07;
  options.bias_density << 0.01, 0.02, 0.03, 0.004, 0.005, 0.006;
  options.prior_twist_sigma.setConstant(0.3);
  options.prior_bias_sigma.setConstant(0.02);
  options.velocity_sigma = 0.5;
  options.gyro_sigma = 0.05;
  return options;
}

ConstantTwist::Options withoutNoise(ConstantTwist::Options options) {
  options.twist_density.setZero();
  options.bias_density.setZero();
  return options;
}

StereoModel Scene::model() const {
  StereoModel::Options options;
  options.pixel_sigma = 0.7;
  return StereoModel(exampleRig(), options, RigVariables(filter.variables()));
}

void Scene::addPoint(Random& random, double variance) {
  filter.settle();
  const Eigen::Vector3d q(random.uniform(-4.0, 4.0), random.uniform(-1.0, 2.0), random.uniform(5.0, 20.0));
  points.push_back(filter.augment(Chart::kPoint, worldTCam() * q, variance * random.covariance<3>()));
}

StereoPixels Scene::expectedPixels(Handle point) const {
  StereoCamera camera = exampleRig().camera;
  if (scale) camera.baseline *= 1.0 + filter.variables().mean(*scale)[0];
  return camera.project(worldTCam().inverse() * filter.variables().point(point));
}

std::vector<LinearMeasurement> Scene::seen(Random& random, double offset) const {
  std::vector<LinearMeasurement> all;
  for (const Handle point : points) {
    const StereoPixels off = offset * random.vector<4>(-1.0, 1.0);
    const auto z = model().observe(filter, point, expectedPixels(point) + off);
    if (z) all.push_back(*z);
  }
  return all;
}

Scene coreScene(Random& random, const RigVariables::Options& rig, const ConstantTwist::Options& options) {
  Scene scene{Filter({so3::Exp({0.1, -0.2, 0.3}), {30.0, -20.0, 5.0}}, 0.01 * random.covariance<6>()),
              ConstantTwist(options),
              {},
              {}};
  scene.motion.addTo(scene.filter);
  RigVariables::addTo(scene.filter, rig);
  scene.scale = scene.filter.variables().find("scale");
  scene.filter.closeCore();
  return scene;
}

RigVariables::Options scaleOf(double sigma) {
  RigVariables::Options rig;
  rig.scale_sigma = sigma;
  return rig;
}

Scene coreScene(Random& random, double scale_sigma, const ConstantTwist::Options& options) {
  return coreScene(random, scaleOf(scale_sigma), options);
}

Scene busyScene(Random& random, std::size_t points, const RigVariables::Options& rig) {
  Scene scene = coreScene(random, rig);
  Vector6d twist;
  twist << 8.0, 0.3, -0.2, 0.05, -0.1, 0.4;
  scene.filter.setMean(handleOf(scene.filter, ConstantTwist::kTwist), twist);
  scene.filter.setMean(handleOf(scene.filter, ConstantTwist::kBias), 0.01 * random.vector<6>(-1.0, 1.0));
  if (scene.scale) scene.filter.setMean(*scene.scale, Eigen::VectorXd::Constant(1, 0.02));
  for (int i = 0; i < 20; ++i) scene.motion.propagate(scene.filter, 0.1);
  for (std::size_t i = 0; i < points; ++i) scene.addPoint(random);
  for (const Handle point : scene.points) {
    LinearMeasurement mix(Eigen::Vector3d::Zero(), Eigen::Matrix3d(0.1 * random.covariance<3>()));
    mix.by(0, 0.3 * randomMatrix(random, 3, 6));
    mix.by(scene.filter.rowOf(handleOf(scene.filter, ConstantTwist::kTwist)),
           0.3 * randomMatrix(random, 3, 6));
    mix.by(scene.filter.rowOf(point), 0.3 * randomMatrix(random, 3, 3));
    EXPECT_TRUE(scene.filter.correct(mix));
  }
  scene.motion.propagate(scene.filter, 0.1);
  scene.filter.settle();
  return scene;
}

Scene busyScene(Random& random, std::size_t points, double scale_sigma) {
  return busyScene(random, points, scaleOf(scale_sigma));
}

State stateOf(const Filter& filter) {
  State state{filter.pose(), Eigen::VectorXd::Zero(filter.rows())};
  for (const Handle handle : filter.variables().handles()) {
    if (filter.variables().chartOf(handle) != Chart::kPose)
      state.x.segment(filter.rowOf(handle), filter.variables().sizeOf(handle)) =
          filter.variables().mean(handle);
  }
  return state;
}

State truthAt(const Variables& variables, const State& estimate, const Eigen::VectorXd& error) {
  const Eigen::Matrix3d R = so3::Exp(error.segment<3>(3));
  State truth{{R * estimate.pose.rotation(), estimate.pose.translation() + error.head<3>()}, estimate.x};
  for (const Handle handle : variables.handles()) {
    const Eigen::Index row = variables.rowOf(handle), size = variables.sizeOf(handle);
    const Eigen::VectorXd e = error.segment(row, size), mean = estimate.x.segment(row, size);
    auto x = truth.x.segment(row, size);
    switch (variables.chartOf(handle)) {
      case Chart::kPose:
        break;
      case Chart::kVector:
        x = mean + e;
        break;
      case Chart::kBodyVector: {
        const Eigen::Matrix3d turn = truth.pose.rotation().transpose() * estimate.pose.rotation();
        for (Eigen::Index k = 0; k < size; k += 3)
          x.segment<3>(k) = mean.segment<3>(k) + turn * e.segment<3>(k);
        break;
      }
      case Chart::kWorldVector:
        x = R * (mean + e);
        break;
      case Chart::kPoint:
        x = truth.pose.translation() + R * (mean - estimate.pose.translation() + e);
        break;
    }
  }
  return truth;
}

Eigen::VectorXd errorOf(const Variables& variables, const State& truth, const State& estimate) {
  Eigen::VectorXd error(variables.rows());
  const Eigen::Matrix3d R = truth.pose.rotation() * estimate.pose.rotation().transpose();
  for (const Handle handle : variables.handles()) {
    const Eigen::Index row = variables.rowOf(handle), size = variables.sizeOf(handle);
    const Eigen::VectorXd x = truth.x.segment(row, size), mean = estimate.x.segment(row, size);
    auto e = error.segment(row, size);
    switch (variables.chartOf(handle)) {
      case Chart::kPose:
        e << truth.pose.translation() - estimate.pose.translation(), so3::Log(R);
        break;
      case Chart::kVector:
        e = x - mean;
        break;
      case Chart::kBodyVector: {
        const Eigen::Matrix3d turn = estimate.pose.rotation().transpose() * truth.pose.rotation();
        for (Eigen::Index k = 0; k < size; k += 3) e.segment<3>(k) = turn * (x - mean).segment<3>(k);
        break;
      }
      case Chart::kWorldVector:
        e = R.transpose() * x - mean;
        break;
      case Chart::kPoint:
        e = R.transpose() * (x - truth.pose.translation()) - (mean - estimate.pose.translation());
        break;
    }
  }
  return error;
}

Eigen::MatrixXd derivative(const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& f,
                           Eigen::Index size) {
  constexpr double h = 1e-3;
  Eigen::MatrixXd J;
  for (Eigen::Index i = 0; i < size; ++i) {
    const auto at = [&](double step) -> Eigen::VectorXd { return f(step * Eigen::VectorXd::Unit(size, i)); };
    const Eigen::VectorXd column = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
    if (i == 0) J.resize(column.size(), size);
    J.col(i) = column;
  }
  return J;
}

Eigen::MatrixXd denseOf(const LinearMeasurement& z, Eigen::Index cols) {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(z.rows(), cols);
  for (const LinearMeasurement::Term& term : z) H.middleCols(term.column, term.H.cols()) += term.H;
  return H;
}

DenseMeasurement denseOf(const std::vector<LinearMeasurement>& all, Eigen::Index cols) {
  Eigen::Index rows = 0;
  for (const LinearMeasurement& z : all) rows += z.rows();
  DenseMeasurement dense{Eigen::VectorXd(rows), Eigen::MatrixXd(rows, cols),
                         Eigen::MatrixXd::Zero(rows, rows)};
  Eigen::Index row = 0;
  for (const LinearMeasurement& z : all) {
    dense.residual.segment(row, z.rows()) = z.residual();
    dense.H.middleRows(row, z.rows()) = denseOf(z, cols);
    dense.R.block(row, row, z.rows(), z.rows()) = z.noise();
    row += z.rows();
  }
  return dense;
}

void correct(Filter& filter, const std::vector<LinearMeasurement>& all, const PointChart& chart) {
  Innovation in(filter.covariance(), all);
  ASSERT_TRUE(in.factorise());
  ASSERT_TRUE(filter.correct(in, chart));
}

void correctSeen(Filter& filter, const std::vector<LinearMeasurement>& all, const StereoModel& model) {
  Innovation in(filter.covariance(), all);
  ASSERT_TRUE(in.factorise());
  ASSERT_TRUE(filter.correct(in, model.inverseDepthChart(filter, in.error())));
}

Eigen::MatrixXd gaugeOf(const Filter& filter) {
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(filter.rows(), 6);
  N.topRows<6>().setIdentity();
  N.block<3, 3>(0, 3) = -so3::hat(filter.pose().translation());
  return N;
}

Scaled::Scaled(const Eigen::MatrixXd& P)
    : factors(P.diagonal().cwiseSqrt().cwiseInverse()),
      matrix(factors.asDiagonal() * P * factors.asDiagonal()) {}

Eigen::MatrixXd informationOf(const Eigen::MatrixXd& P, const Eigen::MatrixXd& N) {
  const Scaled scaled(P);
  const Eigen::MatrixXd n = scaled.factors.asDiagonal() * N;
  return n.transpose() * scaled.matrix.llt().solve(n);
}

double worstCorrelationError(const Eigen::MatrixXd& P, const Eigen::MatrixXd& Q) {
  const Eigen::VectorXd scale = Q.diagonal().cwiseSqrt().cwiseInverse();
  return (scale.asDiagonal() * (P - Q) * scale.asDiagonal()).cwiseAbs().maxCoeff();
}

bool isJointlyPositive(const Eigen::MatrixXd& P, double jitter) {
  Eigen::MatrixXd correlations = Scaled(P).matrix;
  correlations.diagonal().array() += jitter;
  return correlations.allFinite() && Eigen::LLT<Eigen::MatrixXd>(correlations).info() == Eigen::Success;
}

void expectCovariance(const Eigen::MatrixXd& P) {
  EXPECT_LE(distance(P, P.transpose()), 1e-13 * P.cwiseAbs().maxCoeff());
  EXPECT_TRUE(isJointlyPositive(P, 1e-12));
}

Eigen::MatrixXd worldAxesOf(const Filter& filter) {
  const Variables& variables = filter.variables();
  Eigen::MatrixXd T = Eigen::MatrixXd::Identity(filter.rows(), filter.rows());
  for (const Handle handle : variables.handles()) {
    if (variables.chartOf(handle) == Chart::kPoint)
      T.block<3, 6>(filter.rowOf(handle), 0) = -byPose(variables.point(handle), filter.pose().translation());
  }
  return T;
}

Eigen::MatrixXd jointOf(Filter filter) {
  filter.settleInactive();
  const Eigen::Index n = filter.rows();
  if (filter.inactive().isEmpty()) return filter.covariance();
  const Eigen::Index N = filter.inactive().covariance().rows();
  Eigen::MatrixXd P(n + N, n + N);
  P << Eigen::MatrixXd(filter.covariance()), filter.inactive().cross(), filter.inactive().cross().transpose(),
      filter.inactive().covariance().middleRows(0, N);
  return P;
}

Eigen::MatrixXd activatedOf(Filter filter) {
  std::vector<Handle> all = filter.inactive().handles();
  filter.activate(all);
  filter.settle();
  return filter.covariance();
}

} // namespace vi_ekf_slam::test
