#include "vi_ekf_slam/core/filter/filter.hpp"

#include <gtest/gtest.h>

#include "dense_filter.hpp"
#include "states.hpp"
#include "vi_ekf_slam/core/filter/direct_update.hpp"

namespace vi_ekf_slam::test {
namespace {

/// The filter and the plain one, through the same operations at random.
class Pair {
 public:
  explicit Pair(unsigned seed)
      : random_(seed), filter_(start(), covariance6()), dense_(filter_.pose(), covariance6()) {
    core_ = {add(Chart::kBodyVector, 6), add(Chart::kWorldVector, 3), add(Chart::kVector, 4)};
    filter_.closeCore();
    dense_.closeCore();
    calibration_ = add(Chart::kVector, 1);
    for (int i = 0; i < 6; ++i) points_.push_back(add(Chart::kPoint, 3));
  }

  void doSomething() {
    const double dice = random_.uniform(0.0, 1.0);
    if (dice < 0.05) {
      moveRest();
    } else if (dice < 0.25) {
      propagate();
    } else if (dice < 0.45) {
      measureCore();
    } else if (dice < 0.55) {
      measureAll();
    } else if (dice < 0.7) {
      measurePoints();
    } else if (dice < 0.8 && points_.size() < 20) {
      points_.push_back(add(Chart::kPoint, 3));
    } else if (dice < 0.83) {
      points_.push_back(add(Chart::kVector, 2));
    } else if (dice < 0.9) {
      deactivate();
    } else if (dice < 0.93) {
      remove();
    } else if (dice < 0.95) {
      activate();
    } else if (dice < 0.96) {
      clones_.push_back(filter_.clonePose());
      dense_.clonePose(clones_.back());
    } else if (dice < 0.97) {
      const Handle handle = anyOf(points_);
      const Eigen::MatrixXd noise = randomCovariance(random_, filter_.variables().sizeOf(handle), 1e-3);
      filter_.addNoise(filter_.rowOf(handle), noise);
      dense_.addNoise(handle, noise);
    } else if (dice < 0.98) {
      filter_.beginSettlingInactive(); // ends some time later
    } else if (dice < 0.985) {
      filter_.endSettlingInactive();
    } else if (dice < 0.99) {
      filter_.settleInactive();
      dense_.settle();
    } else if (dice < 0.995) {
      const Eigen::MatrixXd covariance = randomCovariance(random_, 6, 0.1);
      filter_.makeIndependent(filter_.rowOf(core_[0]), covariance);
      dense_.reset(core_[0], covariance);
    } else {
      dense_.settle();
      for (const Handle handle : filter_.marginaliseOldest(1)) {
        dense_.remove(handle);
        auto& kind = std::count(clones_.begin(), clones_.end(), handle) > 0 ? clones_ : inactive_;
        kind.erase(std::find(kind.begin(), kind.end(), handle));
      }
    }
  }

  /// Both at the end of a period; of the filter a copy.
  void compare() {
    Filter filter = filter_;
    filter.settle();
    DenseFilter dense = dense_;
    dense.settle();
    const double scale = dense.covariance().cwiseAbs().maxCoeff();
    std::vector<std::pair<Eigen::Index, Eigen::Index>> rows; // in the filter, in the dense one
    for (const auto& v : dense.variables()) {
      if (!v.active) continue;
      for (Eigen::Index k = 0; k < v.mean.size(); ++k)
        rows.emplace_back(filter.rowOf(v.handle) + k, v.row + k);
      if (v.chart == Chart::kPose) continue;
      ASSERT_LE(distance(filter.variables().mean(v.handle), v.mean), 1e-9);
    }
    ASSERT_LE(distance(filter.pose().matrix(), dense.pose().matrix()), 1e-9);
    ASSERT_EQ(static_cast<Eigen::Index>(rows.size()), filter.rows());
    for (const auto& [a, da] : rows) {
      for (const auto& [b, db] : rows)
        ASSERT_NEAR(filter.covariance()(a, b), dense.covariance()(da, db), 1e-9 * scale);
    }
    const auto exact = filter.inactive().estimates(true);
    ASSERT_EQ(exact.size(), inactive_.size() + clones_.size());
    for (const auto& estimate : exact) {
      const auto& v = dense.of(estimate.variable.handle);
      ASSERT_LE(distance(estimate.variable.mean, v.mean), 1e-9);
      const Eigen::Index k = v.mean.size();
      ASSERT_LE(distance(estimate.covariance, dense.covariance().block(v.row, v.row, k, k)), 1e-9 * scale);
    }
    for (const auto& estimate : exact) {
      const Handle handle = estimate.variable.handle;
      const auto related = filter.inactive().related(handle);
      ASSERT_LE(distance(related.estimate.variable.mean, estimate.variable.mean), 1e-12);
      ASSERT_LE(distance(related.estimate.covariance, estimate.covariance), 1e-12 * scale);
      const auto& v = dense.of(handle);
      for (const auto& [a, da] : rows) {
        const Eigen::RowVectorXd theirs = dense.covariance().block(da, v.row, 1, v.mean.size());
        ASSERT_LE(distance(related.cross.row(a), theirs), 1e-9 * scale);
      }
    }
    if (inactive_.empty()) return;
    std::vector<Handle> back = inactive_;
    filter.activate(back);
    for (const Handle handle : back) dense.activate(handle);
    for (const Handle a : back) {
      for (const auto& b : dense.variables()) {
        if (!b.active) continue;
        const Eigen::MatrixXd theirs =
            dense.covariance().block(dense.of(a).row, b.row, dense.of(a).mean.size(), b.mean.size());
        ASSERT_LE(distance(filter.covariance(a, b.handle), theirs), 1e-9 * scale);
      }
    }
    const Eigen::MatrixXd P = filter.covariance();
    const Eigen::VectorXd scaling = P.diagonal().cwiseSqrt().cwiseInverse();
    ASSERT_TRUE(isPositive(scaling.asDiagonal() * P * scaling.asDiagonal(), 1e-12));
  }

 private:
  static SE3 start() { return {so3::Exp({0.1, -0.2, 0.3}), {30.0, -20.0, 5.0}}; }
  static Matrix6d covariance6() { return Vector6d::Constant(0.01).asDiagonal(); }

  Handle anyOf(const std::vector<Handle>& handles) {
    return handles[static_cast<std::size_t>(random_.uniform(0.0, 0.999) *
                                            static_cast<double>(handles.size()))];
  }

  Handle add(Chart chart, Eigen::Index size) {
    Eigen::VectorXd mean = randomMatrix(random_, size, 1);
    if (chart == Chart::kPoint) mean = filter_.pose().translation() + random_.vector<3>(-20.0, 20.0);
    filter_.settle();
    Eigen::MatrixXd J = 0.3 * randomMatrix(random_, size, filter_.rows());
    if (random_.uniform(0.0, 1.0) < 0.5) J.setZero();
    const Eigen::MatrixXd noise = randomCovariance(random_, size, 0.02);
    const Handle handle =
        filter_.augment(chart, mean, noise, J.isZero() ? LinearFunction{} : LinearFunction{0, J});
    dense_.augment(handle, chart, mean, noise, inDense(J));
    return handle;
  }

  /// H of the filter's active rows, in the rows of the dense one.
  Eigen::MatrixXd inDense(const Eigen::MatrixXd& H) {
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(H.rows(), dense_.covariance().rows());
    for (const auto& v : dense_.variables()) {
      if (v.active && filter_.variables().contains(v.handle) && filter_.rowOf(v.handle) < H.cols())
        result.middleCols(v.row, v.mean.size()) = H.middleCols(filter_.rowOf(v.handle), v.mean.size());
    }
    return result;
  }

  void propagate() {
    const Eigen::Index c = filter_.coreRows();
    CoreStep step;
    step.row = random_.uniform(0.0, 1.0) < 0.5 ? 0 : 6;
    const Eigen::Index w = c - step.row, k = step.row == 0 ? c : 6;
    step.F = Eigen::MatrixXd::Identity(k, w) + 0.1 * randomMatrix(random_, k, w);
    step.Q = randomCovariance(random_, w - 1, 1e-4);
    step.pose = filter_.pose() * SE3::Exp(random_.vector<6>(-0.3, 0.3));
    step.means.emplace_back(core_[1], random_.vector<3>(-5.0, 5.0));
    filter_.propagate(step);
    dense_.propagate(step);
  }

  void moveRest() {
    filter_.settle();
    dense_.settle(); // both: the period that may follow begins at the means of now
    const Eigen::MatrixXd G = 0.1 * randomMatrix(random_, filter_.rows() - filter_.coreRows(), 4);
    if (random_.uniform(0.0, 1.0) < 0.5) propagate();
    filter_.moveRest(core_[2], G);
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(filter_.rows(), 4);
    all.bottomRows(G.rows()) = G;
    dense_.moveBy(core_[2], inDense(all.transpose()).transpose());
  }

  void measureCore() {
    const auto rows = static_cast<Eigen::Index>(random_.uniform(1.0, 6.99));
    LinearMeasurement z(0.05 * randomMatrix(random_, rows, 1), randomCovariance(random_, rows, 0.1));
    z.by(0, randomMatrix(random_, rows, 6)).by(filter_.rowOf(core_[0]), randomMatrix(random_, rows, 6));
    z.by(filter_.rowOf(core_[2]) + 1, randomMatrix(random_, rows, 2));
    ASSERT_TRUE(filter_.correct(z));
    correctDense({z}, {}, true);
  }

  /// Whatever variables.
  void measureAll() {
    filter_.settle();
    const auto rows = static_cast<Eigen::Index>(random_.uniform(1.0, 6.99));
    LinearMeasurement z(0.05 * randomMatrix(random_, rows, 1), randomCovariance(random_, rows, 0.1));
    for (int i = 0; i < 2; ++i) {
      const Handle handle = anyOf(points_);
      z.by(filter_.rowOf(handle), randomMatrix(random_, rows, filter_.variables().sizeOf(handle)));
    }
    z.by(0, randomMatrix(random_, rows, 6));
    ASSERT_TRUE(filter_.correct(z));
    correctDense({z}, {}, false);
  }

  /// As a frame does: most points directly, some by the calibration too, some noisier than others.
  void measurePoints() {
    filter_.settle();
    dense_.settle();
    std::vector<LinearMeasurement> all;
    const double share = random_.uniform(0.3, 1.0);
    for (const Handle handle : points_) {
      if (filter_.variables().chartOf(handle) != Chart::kPoint || random_.uniform(0.0, 1.0) > share) continue;
      const double sigma = random_.uniform(0.05, 0.5);
      LinearMeasurement z(0.05 * randomMatrix(random_, 3, 1), sigma * sigma * Eigen::Matrix3d::Identity());
      z.by(filter_.rowOf(handle),
           Eigen::Matrix3d(Eigen::Matrix3d::Identity() + 0.3 * randomMatrix(random_, 3, 3)));
      if (random_.uniform(0.0, 1.0) < 0.5) z.by(filter_.rowOf(calibration_), randomMatrix(random_, 3, 1));
      all.push_back(z);
    }
    if (all.empty()) return;
    Innovation in(filter_.covariance(), all);
    std::vector<bool> chosen(all.size(), true);
    if (all.size() > 2) {
      chosen[all.size() / 2] = false;
      all.erase(all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2));
    }
    in.putFirst(chosen);
    in.drop();
    ASSERT_TRUE(in.factorise());
    direct_ += DirectUpdate::make(in) ? 1 : 0;
    const PointChart chart{
        [](const Eigen::Matrix3d& turn, const Eigen::Vector3d& way, const Eigen::Vector3d& d) {
          Eigen::Matrix3d M = Eigen::Matrix3d::Identity();
          M = (M + 0.1 * std::sin(way.x()) * turn).eval();
          if (way.x() < 0.0) return std::optional<MovedPoint>();
          return std::optional<MovedPoint>(MovedPoint{way + M * d, M, {}});
        }};
    ASSERT_TRUE(filter_.correct(in, chart));
    correctDense(all, chart, false);
  }

  void correctDense(const std::vector<LinearMeasurement>& all, const PointChart& chart, bool core) {
    Eigen::Index rows = 0;
    for (const auto& z : all) rows += z.rows();
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(rows, filter_.rows()), R = Eigen::MatrixXd::Zero(rows, rows);
    Eigen::VectorXd residual(rows);
    Eigen::Index row = 0;
    for (const auto& z : all) {
      for (const auto& term : z) H.block(row, term.column, z.rows(), term.H.cols()) += term.H;
      R.block(row, row, z.rows(), z.rows()) = z.noise();
      residual.segment(row, z.rows()) = z.residual();
      row += z.rows();
    }
    dense_.correct(inDense(H), R, residual, chart, core);
  }

  void deactivate() {
    if (points_.size() < 3) return;
    const Handle handle = anyOf(points_);
    filter_.deactivate(handle);
    dense_.deactivate(handle);
    points_.erase(std::find(points_.begin(), points_.end(), handle));
    inactive_.push_back(handle);
  }

  void remove() {
    if (points_.size() < 3) return;
    const Handle handle = anyOf(points_);
    filter_.remove(handle);
    dense_.remove(handle);
    points_.erase(std::find(points_.begin(), points_.end(), handle));
  }

  void activate() {
    std::vector<Handle> back;
    for (int i = 0; i < 2 && !inactive_.empty(); ++i) {
      back.push_back(anyOf(inactive_));
      inactive_.erase(std::find(inactive_.begin(), inactive_.end(), back.back()));
    }
    if (back.empty()) return;
    filter_.activate(back);
    for (const Handle handle : back) {
      dense_.activate(handle);
      points_.push_back(handle);
    }
  }

  Random random_;
  Filter filter_;
  DenseFilter dense_;
  std::vector<Handle> core_, points_, inactive_, clones_;
  Handle calibration_ = 0;

 public:
  int direct_ = 0;
};

TEST(Filter, EqualsThePlainDenseFilterWhateverIsDone) {
  int direct = 0;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    Pair pair(seed);
    for (int i = 0; i < 300; ++i) {
      pair.doSomething();
      if (i % 20 == 0) pair.compare();
      if (HasFatalFailure()) FAIL() << "seed " << seed << ", step " << i;
    }
    direct += pair.direct_;
  }
  EXPECT_GT(direct, 25);
}

} // namespace
} // namespace vi_ekf_slam::test
