#include "vi_ekf_slam/core/filter/compressed_core.hpp"

#include "states.hpp"

namespace vi_ekf_slam::test {
namespace {

/// A core, and what became of it and of one error outside of it, step by step.
class Stepped {
 public:
  Stepped(Random& random, Eigen::Index size, Eigen::Index rest)
      : size_(size), P_(randomCovariance(random, size + rest, 1.0)), start_(P_), core_(size) {
    core_.open({1.0, 2.0, 3.0}, P_.topLeftCorner(size, size));
    error_ = Eigen::VectorXd::Zero(size + rest);
  }

  void propagate(const Eigen::MatrixXd& F, double noise) {
    core_.transform(0, F);
    Eigen::MatrixXd all = Eigen::MatrixXd::Identity(P_.rows(), P_.rows());
    all.topLeftCorner(size_, size_) = F;
    P_ = (all * P_ * all.transpose()).eval();
    P_.topLeftCorner(size_, size_).diagonal().array() += noise;
    error_ = (all * error_).eval();
  }

  void correct(const Eigen::MatrixXd& H, const Eigen::MatrixXd& R, const Eigen::VectorXd& z) {
    const Eigen::MatrixXd PHt = P_.leftCols(size_) * H.transpose();
    const Eigen::MatrixXd S = H * PHt.topRows(size_) + R;
    const Eigen::VectorXd nu = z - H * error_.head(size_);
    LinearMeasurement measurement(nu, R);
    for (Eigen::Index column = 0; column < size_; column += 6) {
      const Eigen::Index width = std::min<Eigen::Index>(6, size_ - column);
      if (!H.middleCols(column, width).isZero(0.0)) measurement.by(column, H.middleCols(column, width));
    }
    const Eigen::MatrixXd L_inverse = S.llt().matrixL().solve(Eigen::MatrixXd::Identity(S.rows(), S.cols()));
    using Columns = CoreColumns<Eigen::Dynamic>;
    Columns A = Columns::Zero(core_.padded(), S.rows());
    A.topRows(size_) = PHt.topRows(size_) * L_inverse.transpose();
    core_.correct(measurement, L_inverse, SmallVector(L_inverse * nu), A);
    const Eigen::MatrixXd K = PHt * inverseOf(S);
    P_ -= K * S * K.transpose();
    error_ += K * nu;
  }

  /// Of the errors outside: P_rr, P_rc and their expectation are what the core says they are.
  void expectRest() const {
    const Eigen::Index c = size_, r = P_.rows() - c;
    const Eigen::MatrixXd before = start_.bottomLeftCorner(r, c), Gamma = core_.Gamma();
    const Eigen::MatrixXd learned = before * Gamma;
    EXPECT_LT(
        distance(P_.bottomRightCorner(r, r), start_.bottomRightCorner(r, r) - learned * learned.transpose()),
        1e-9);
    EXPECT_LT(distance(P_.bottomLeftCorner(r, c), before * core_.Phi().transpose()), 1e-9);
    EXPECT_LT(distance(error_.tail(r), before * core_.psi()), 1e-9);
    EXPECT_LE(Gamma.cols(), c);
  }

  const CompressedCore& core() const { return core_; }

 private:
  Eigen::Index size_;
  Eigen::MatrixXd P_, start_;
  Eigen::VectorXd error_;
  CompressedCore core_;
};

TEST(CompressedCoreTest, SaysWhatBecameOfAllTheOthers) {
  Random random(1);
  for (int run = 0; run < 10; ++run) {
    Stepped stepped(random, 12, 7);
    for (int i = 0; i < 15; ++i) {
      stepped.propagate(Eigen::MatrixXd::Identity(12, 12) + 0.1 * randomMatrix(random, 12, 12), 1e-3);
      if (i % 2 == 0)
        stepped.correct(randomMatrix(random, 3, 12), randomCovariance(random, 3, 0.1),
                        randomMatrix(random, 3, 1));
    }
    stepped.expectRest();
  }
}

TEST(CompressedCoreTest, HasRoomForTheLargestCoreAndRefusesALargerOne) {
  Random random(7);
  Stepped stepped(random, kMostCoreRows, 7);
  Eigen::MatrixXd F = Eigen::MatrixXd::Identity(kMostCoreRows, kMostCoreRows);
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(3, kMostCoreRows);
  for (int i = 0; i < 15; ++i) {
    F.bottomLeftCorner<6, 6>() = 0.1 * randomMatrix(random, 6, 6);
    stepped.propagate(F, 1e-3);
    H.leftCols<6>() = randomMatrix(random, 3, 6);
    H.rightCols<4>() = randomMatrix(random, 3, 4);
    stepped.correct(H, randomCovariance(random, 3, 0.1), randomMatrix(random, 3, 1));
  }
  stepped.expectRest();

  Filter filter(SE3(), Matrix6d::Identity());
  const Eigen::Index most = kMostCoreRows - filter.rows();
  filter.augment(Chart::kVector, Eigen::VectorXd::Zero(most), Eigen::MatrixXd::Identity(most, most));
  EXPECT_NO_THROW(filter.closeCore());
  filter.augment(Chart::kVector, Eigen::VectorXd::Zero(1), Eigen::MatrixXd::Identity(1, 1));
  EXPECT_THROW(filter.closeCore(), std::logic_error);
}

// Omega is singular, and of blocks that are the same: a sum of two errors is measured.
TEST(CompressedCoreTest, LosesNothingWhereASumOfErrorsIsMeasured) {
  Random random(2);
  for (const int samples : {1, 2, 10}) {
    Stepped stepped(random, 18, 5);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(3, 18);
    for (int i = 0; i < samples; ++i) {
      const Eigen::Index axis = i % 2 == 0 ? 0 : 3;
      H.setZero();
      H.middleCols<3>(6 + axis).setIdentity();
      H.middleCols<3>(12 + axis).setIdentity();
      stepped.correct(H, 0.01 * Eigen::Matrix3d::Identity(), randomMatrix(random, 3, 1));
    }
    EXPECT_EQ(stepped.core().Gamma().cols(), samples == 1 ? 3 : 6) << samples;
    stepped.expectRest();
  }
}

TEST(CompressedCoreTest, LosesNothingWhereUnitsAreFarApart) {
  Random random(3);
  Stepped stepped(random, 6, 4);
  const Eigen::MatrixXd scale =
      (Eigen::VectorXd(6) << 1.0, 1e-3, 1e3, 1.0, 1e-2, 1e2).finished().asDiagonal();
  for (int i = 0; i < 4; ++i)
    stepped.correct(randomMatrix(random, 2, 6) * scale, randomCovariance(random, 2, 0.1),
                    randomMatrix(random, 2, 1));
  stepped.expectRest();
}

TEST(CompressedCoreTest, HasLearnedNothingWhereNothingWasMeasured) {
  Random random(4);
  Stepped stepped(random, 9, 2);
  stepped.propagate(randomMatrix(random, 9, 9), 0.1);
  EXPECT_EQ(stepped.core().Gamma().cols(), 0);
  EXPECT_EQ(stepped.core().psi(), Eigen::VectorXd::Zero(9));
  stepped.expectRest();
}

TEST(CompressedCoreTest, SomeRowsMoveAsAllDoWhereTheOthersStay) {
  Random random(6);
  const Eigen::MatrixXd P = randomCovariance(random, 9, 1.0), F = randomMatrix(random, 4, 6);
  Eigen::MatrixXd all = Eigen::MatrixXd::Identity(9, 9);
  all.block(3, 3, 4, 6) = F;
  CompressedCore some(9), whole(9);
  for (CompressedCore* core : {&some, &whole}) {
    core->open(Eigen::Vector3d::Zero(), P);
    core->transform(0, randomCovariance(random, 9, 1.0));
  }
  whole.Phi() = some.Phi();
  some.transform(3, F);
  whole.transform(0, all);
  EXPECT_LT(distance(some.Phi(), whole.Phi()), 1e-14 * whole.Phi().norm());
}

TEST(CompressedCoreTest, BeginsAPeriodWhereNoneIsUnderWay) {
  Random random(5);
  CompressedCore core(6);
  EXPECT_FALSE(core.isOpen());
  const Eigen::MatrixXd first = randomCovariance(random, 6, 1.0), second = randomCovariance(random, 6, 1.0);
  core.open({1.0, 0.0, 0.0}, first);
  core.transform(2, randomMatrix(random, 3, 4));
  core.open({2.0, 0.0, 0.0}, second);
  EXPECT_EQ(core.covariance(), first);
  EXPECT_EQ(core.position(), Eigen::Vector3d(1.0, 0.0, 0.0));
  core.close();
  core.open({2.0, 0.0, 0.0}, second);
  EXPECT_EQ(core.covariance(), second);
  EXPECT_EQ(core.Phi(), Eigen::MatrixXd::Identity(6, 6));
}

} // namespace
} // namespace vi_ekf_slam::test
