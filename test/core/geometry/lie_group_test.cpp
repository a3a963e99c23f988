#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "../exp_series.hpp"
#include "../numeric.hpp"
#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

using test::distance;
using test::expSeries;
using test::integratedExpSeries;
using test::numericJacobian;
using test::Random;

constexpr double kPi = 3.14159265358979323846;

/// SO(3) under the names that the laws below use.
struct Rotation {
  static constexpr int kDim = 3;
  using Element = Eigen::Matrix3d;
  using Tangent = Eigen::Vector3d;
  using Square = Eigen::Matrix3d;

  static Element identity() { return Eigen::Matrix3d::Identity(); }
  static Element Exp(const Tangent& x) { return so3::Exp(x); }
  static Tangent Log(const Element& g) { return so3::Log(g); }
  static Element inverse(const Element& g) { return g.transpose(); }
  static Eigen::MatrixXd matrix(const Element& g) { return g; }
  static Eigen::MatrixXd hat(const Tangent& x) { return so3::hat(x); }
  static Square ad(const Tangent& x) { return so3::hat(x); }
  static Square adjoint(const Element& g) { return g; }
  static Square leftJacobian(const Tangent& x) { return so3::leftJacobian(x); }
  static Element normalized(const Element& g) { return so3::normalized(g); }
  static Tangent tangent(Random&, const Eigen::Vector3d& phi) { return phi; }
};

/// SE(3) likewise.
struct Pose {
  static constexpr int kDim = 6;
  using Element = SE3;
  using Tangent = Vector6d;
  using Square = Matrix6d;

  static Element identity() { return SE3(); }
  static Element Exp(const Tangent& x) { return SE3::Exp(x); }
  static Tangent Log(const Element& g) { return g.Log(); }
  static Element inverse(const Element& g) { return g.inverse(); }
  static Eigen::MatrixXd matrix(const Element& g) { return g.matrix(); }
  static Eigen::MatrixXd hat(const Tangent& x) {
    Eigen::Matrix4d m = Eigen::Matrix4d::Zero();
    m.topRows<3>() << so3::hat(x.tail<3>()), x.head<3>();
    return m;
  }
  static Square ad(const Tangent& x) {
    Square m;
    m << so3::hat(x.tail<3>()), so3::hat(x.head<3>()), Eigen::Matrix3d::Zero(), so3::hat(x.tail<3>());
    return m;
  }
  static Square adjoint(const Element& g) { return g.adjoint(); }
  static Square leftJacobian(const Tangent& x) { return se3::leftJacobian(x); }
  static Element normalized(const Element& g) { return g.normalized(); }
  static Tangent tangent(Random& random, const Eigen::Vector3d& phi) {
    Tangent x;
    x << random.vector<3>(-2.0, 2.0), phi;
    return x;
  }
};

/// Angles at which an implementation can go wrong: zero, tiny, both sides of where series may give way to
/// closed forms, ordinary, and close to pi.
std::vector<double> angles() {
  std::vector<double> all{0.0};
  for (double tiny = 1e-12; tiny < 2e-3; tiny *= 10.0) all.push_back(tiny);
  for (const double bend : {1e-10, 1e-8, 1e-5, 1e-4, 1e-2, 0.1, 0.5}) {
    for (const double side : {1.0 - 1e-9, 1.0, 1.0 + 1e-9}) all.push_back(bend * side);
  }
  for (const double ordinary : {0.3, 1.0, 1.7, 2.5, 3.0}) all.push_back(ordinary);
  for (const double gap : {1e-1, 1e-3, 1e-6, 1e-9}) all.push_back(kPi - gap);
  return all;
}

template <typename Group>
class LieGroup : public ::testing::Test {
 public:
  using Tangent = typename Group::Tangent;

  static const std::vector<Tangent>& tangents() {
    static const std::vector<Tangent> all = [] {
      Random random(1);
      std::vector<Tangent> result{Tangent::Zero()};
      for (const double angle : angles()) {
        for (int i = 0; i < 4; ++i) result.push_back(Group::tangent(random, angle * random.direction()));
        result.push_back(Group::tangent(random, angle * Eigen::Vector3d::UnitX()));
        result.push_back(Group::tangent(random, -angle * Eigen::Vector3d::UnitZ()));
      }
      return result;
    }();
    return all;
  }
};

using Groups = ::testing::Types<Rotation, Pose>;

struct GroupNames {
  template <typename Group>
  static std::string GetName(int) {
    return Group::kDim == 3 ? "SO3" : "SE3";
  }
};

TYPED_TEST_SUITE(LieGroup, Groups, GroupNames);

TYPED_TEST(LieGroup, ExpOfZeroIsTheIdentityAndLogOfTheIdentityIsZero) {
  using G = TypeParam;
  EXPECT_EQ(distance(G::matrix(G::Exp(G::Tangent::Zero())), G::matrix(G::identity())), 0.0);
  EXPECT_EQ(G::Log(G::identity()).norm(), 0.0);
}

TYPED_TEST(LieGroup, IdentityIsNeutral) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    const auto g = G::Exp(x);
    EXPECT_EQ(distance(G::matrix(g * G::identity()), G::matrix(g)), 0.0);
    EXPECT_EQ(distance(G::matrix(G::identity() * g), G::matrix(g)), 0.0);
  }
}

TYPED_TEST(LieGroup, InverseUndoesBothFromLeftAndRight) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    const auto g = G::Exp(x);
    EXPECT_LT(distance(G::matrix(g * G::inverse(g)), G::matrix(G::identity())), 1e-14) << x.transpose();
    EXPECT_LT(distance(G::matrix(G::inverse(g) * g), G::matrix(G::identity())), 1e-14) << x.transpose();
  }
}

TYPED_TEST(LieGroup, ExpOfTheNegativeIsTheInverse) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    EXPECT_LT(distance(G::matrix(G::Exp(-x)), G::matrix(G::inverse(G::Exp(x)))), 2e-14) << x.transpose();
  }
}

TYPED_TEST(LieGroup, CompositionIsAssociativeAndTheMatrixProduct) {
  using G = TypeParam;
  const auto& x = this->tangents();
  for (std::size_t i = 0; i + 2 < x.size(); ++i) {
    const auto a = G::Exp(x[i]), b = G::Exp(x[x.size() - 1 - i]), c = G::Exp(x[i + 2]);
    const typename G::Element left = (a * b) * c, right = a * (b * c);
    EXPECT_LT(distance(G::matrix(left), G::matrix(right)), 1e-14);
    EXPECT_LT(distance(G::matrix(a * b), G::matrix(a) * G::matrix(b)), 1e-14);
  }
}

TYPED_TEST(LieGroup, ExpIsTheMatrixExponentialSeries) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    const auto reference = expSeries(G::hat(x).template cast<long double>());
    EXPECT_LT(distance(G::matrix(G::Exp(x)), reference), 5e-15) << x.transpose();
  }
}

TYPED_TEST(LieGroup, LogUndoesExp) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    const typename G::Tangent back = G::Log(G::Exp(x));
    EXPECT_LT((back - x).norm(), 1e-13) << x.transpose();
    // Rotations far below one rad keep their relative accuracy.
    const double angle = x.template tail<3>().norm();
    EXPECT_LE((back - x).template tail<3>().norm(), 1e-12 * angle) << x.transpose();
  }
}

TYPED_TEST(LieGroup, ExpUndoesLogUpToPiAndBeyond) {
  using G = TypeParam;
  Random random(2);
  for (const double angle : {3.0, kPi - 1e-12, kPi, kPi + 1e-12, kPi + 1e-3, 4.0, 6.0}) {
    for (int i = 0; i < 10; ++i) {
      const auto g = G::Exp(G::tangent(random, angle * random.direction()));
      const typename G::Tangent log = G::Log(g);
      EXPECT_LE(log.template tail<3>().norm(), kPi + 1e-14);
      EXPECT_LT(distance(G::matrix(G::Exp(log)), G::matrix(g)), 2e-14) << angle;
    }
  }
}

TYPED_TEST(LieGroup, AdjointMovesATangentThroughTheElement) {
  using G = TypeParam;
  const auto& x = this->tangents();
  for (std::size_t i = 0; i < x.size(); ++i) {
    const auto g = G::Exp(x[i]);
    const auto& y = x[(7 * i + 3) % x.size()];
    const auto moved = G::Exp(G::adjoint(g) * y);
    EXPECT_LT(distance(G::matrix(g * G::Exp(y) * G::inverse(g)), G::matrix(moved)), 5e-14);
  }
}

TYPED_TEST(LieGroup, AdjointOfAProductIsTheProductOfAdjoints) {
  using G = TypeParam;
  const auto& x = this->tangents();
  for (std::size_t i = 0; i < x.size(); ++i) {
    const auto a = G::Exp(x[i]), b = G::Exp(x[(5 * i + 1) % x.size()]);
    EXPECT_LT(distance(G::adjoint(a * b), G::adjoint(a) * G::adjoint(b)), 2e-14);
  }
}

TYPED_TEST(LieGroup, AdjointOfExpIsTheExponentialOfTheAlgebraAdjoint) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    const auto reference = expSeries(G::ad(x).template cast<long double>());
    EXPECT_LT(distance(G::adjoint(G::Exp(x)), reference), 1e-14) << x.transpose();
  }
}

TYPED_TEST(LieGroup, AlgebraAdjointIsTheDerivativeOfTheAdjoint) {
  using G = TypeParam;
  constexpr int n = G::kDim;
  for (const auto& x : this->tangents()) {
    const auto adjoint_along = [&](const Eigen::Matrix<double, 1, 1>& t) {
      const typename G::Square Ad = G::adjoint(G::Exp(t[0] * x));
      return Eigen::Matrix<double, n * n, 1>(Eigen::Map<const Eigen::Matrix<double, n * n, 1>>(Ad.data()));
    };
    const auto slope = numericJacobian<n * n, 1>(adjoint_along, Eigen::Matrix<double, 1, 1>::Zero().eval());
    const Eigen::Map<const typename G::Square> derivative(slope.data());
    EXPECT_LT(distance(G::ad(x), derivative), 1e-9) << x.transpose();
  }
}

TYPED_TEST(LieGroup, AlgebraAdjointIsTheLieBracket) {
  using G = TypeParam;
  const auto& x = this->tangents();
  for (std::size_t i = 0; i < x.size(); ++i) {
    const auto& y = x[(11 * i + 5) % x.size()];
    const Eigen::MatrixXd bracket = G::hat(x[i]) * G::hat(y) - G::hat(y) * G::hat(x[i]);
    EXPECT_LT(distance(G::hat(G::ad(x[i]) * y), bracket), 1e-14);
  }
}

TYPED_TEST(LieGroup, LeftJacobianIsTheNumericDerivativeOfExp) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    const auto inverse = G::inverse(G::Exp(x));
    const auto difference = [&](const typename G::Tangent& moved) { return G::Log(G::Exp(moved) * inverse); };
    EXPECT_LT(distance(G::leftJacobian(x), numericJacobian<G::kDim, G::kDim>(difference, x)), 1e-10)
        << x.transpose();
  }
}

TYPED_TEST(LieGroup, LeftJacobianIsItsPowerSeries) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    const auto reference = integratedExpSeries(G::ad(x).template cast<long double>());
    EXPECT_LT(distance(G::leftJacobian(x), reference), 2e-14) << x.transpose();
  }
}

TYPED_TEST(LieGroup, NothingJumpsWhereTheSeriesGivesWayToTheClosedForm) {
  using G = TypeParam;
  Random random(3);
  for (double angle = 1e-12; angle < 1.0; angle *= 1.01) {
    const typename G::Tangent below = G::tangent(random, angle * (1.0 - 1e-13) * random.direction());
    typename G::Tangent above = below;
    above.template tail<3>() *= 1.0 + 2e-13;
    EXPECT_LT(distance(G::matrix(G::Exp(below)), G::matrix(G::Exp(above))), 5e-15 + 1e-12 * angle);
    EXPECT_LT(distance(G::leftJacobian(below), G::leftJacobian(above)), 5e-15 + 1e-12 * angle);
    EXPECT_LT(distance(G::Log(G::Exp(below)), G::Log(G::Exp(above))), 1e-14 + 1e-12 * angle);
  }
}

TYPED_TEST(LieGroup, NormalizedLeavesAnElementOfTheGroupAlone) {
  using G = TypeParam;
  for (const auto& x : this->tangents()) {
    const auto g = G::Exp(x);
    EXPECT_LT(distance(G::matrix(G::normalized(g)), G::matrix(g)), 2e-15) << x.transpose();
  }
}

TEST(Rotation, NormalizedUndoesTheDriftOfTheMatrix) {
  Random random(4);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Matrix3d R = so3::Exp(random.vector<3>(-2.0, 2.0));
    Eigen::Matrix3d drifted = R;
    for (int k = 0; k < 9; ++k) drifted(k) += random.uniform(-1e-6, 1e-6);
    ASSERT_FALSE(so3::isRotation(drifted, 1e-9));
    const Eigen::Matrix3d repaired = so3::normalized(drifted);
    EXPECT_TRUE(so3::isRotation(repaired, 1e-14));
    EXPECT_LT(distance(repaired, R), 3e-6);
    const SE3 pose = SE3(drifted, Eigen::Vector3d(1.0, 2.0, 3.0)).normalized();
    EXPECT_EQ(distance(pose.rotation(), repaired), 0.0);
    EXPECT_EQ(distance(pose.translation(), Eigen::Vector3d(1.0, 2.0, 3.0)), 0.0);
  }
}

TEST(Rotation, HatIsTheCrossProduct) {
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    // Whole numbers, whose products and sums are not rounded.
    const Eigen::Vector3d a = random.vector<3>(-300.0, 300.0).array().round();
    const Eigen::Vector3d b = random.vector<3>(-300.0, 300.0).array().round();
    const Eigen::Vector3d cross(a.y() * b.z() - a.z() * b.y(), a.z() * b.x() - a.x() * b.z(),
                                a.x() * b.y() - a.y() * b.x());
    EXPECT_LT(distance(so3::hat(a) * b, cross), 1e-15);
  }
}

TEST(Rotation, ExpAboutZTurnsXTowardsY) {
  EXPECT_LT(distance(so3::Exp({0.0, 0.0, kPi / 2.0}) * Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY()),
            1e-15);
}

TEST(Rotation, LeftJacobianInverseInvertsTheLeftJacobian) {
  Random random(6);
  auto all = angles();
  for (const double beyond_pi : {kPi, 4.0, 5.0, 6.0}) all.push_back(beyond_pi);
  for (const double angle : all) {
    const Eigen::Vector3d phi = angle * random.direction();
    EXPECT_LT(distance(so3::leftJacobianInverse(phi) * so3::leftJacobian(phi), Eigen::Matrix3d::Identity()),
              1e-13)
        << angle;
  }
}

TEST(Rotation, IsRotationRefusesReflectionsScalingsAndNaN) {
  const Eigen::Matrix3d R = so3::Exp({0.1, -0.4, 0.3});
  EXPECT_TRUE(so3::isRotation(R, 1e-12));
  EXPECT_FALSE(so3::isRotation(-R, 1e-12));
  EXPECT_FALSE(so3::isRotation(1.001 * R, 1e-6));
  EXPECT_TRUE(so3::isRotation(1.001 * R, 1e-2));
  Eigen::Matrix3d broken = R;
  broken(1, 1) = std::nan("");
  EXPECT_FALSE(so3::isRotation(broken, 1e9));
}

TEST(Pose, TransformsPointsAsItsMatrixDoes) {
  Random random(7);
  for (int i = 0; i < 20; ++i) {
    const SE3 T = SE3::Exp(random.vector<6>(-2.0, 2.0));
    const Eigen::Vector3d p = random.vector<3>(-10.0, 10.0);
    EXPECT_LT(distance(T * p, (T.matrix() * p.homogeneous()).head<3>()), 1e-14);
  }
}

TEST(Pose, TranslationIsTheOriginOfTheRightFrameInTheLeft) {
  const SE3 a_T_b(so3::Exp({0.0, 0.0, 1.0}), {4.0, 5.0, 6.0});
  EXPECT_EQ(distance(a_T_b * Eigen::Vector3d::Zero(), Eigen::Vector3d(4.0, 5.0, 6.0)), 0.0);
}

TEST(Pose, TangentIsTranslationThenRotation) {
  Vector6d xi;
  xi << 1.0, 2.0, 3.0, 0.0, 0.0, 0.0;
  EXPECT_EQ(distance(SE3::Exp(xi).translation(), Eigen::Vector3d(1.0, 2.0, 3.0)), 0.0);
  EXPECT_EQ(distance(SE3::Exp(xi).rotation(), Eigen::Matrix3d::Identity()), 0.0);
}

TEST(Pose, PointJacobianSwapsTheRolesOfTangentAndPoint) {
  Random random(8);
  for (int i = 0; i < 50; ++i) {
    const Vector6d xi = random.vector<6>(-3.0, 3.0);
    const Eigen::Vector3d x = random.vector<3>(-20.0, 20.0);
    EXPECT_LT(distance(se3::pointJacobian(x) * xi, Pose::hat(xi).topRows(3) * x.homogeneous()), 1e-13);
  }
}

TEST(Pose, PointJacobianIsTheDerivativeOfAMovedPoint) {
  Random random(9);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d x = random.vector<3>(-20.0, 20.0);
    const auto moved = [&](const Vector6d& xi) { return Eigen::Vector3d(SE3::Exp(xi) * x); };
    EXPECT_LT(distance(se3::pointJacobian(x), (numericJacobian<3, 6>(moved, Vector6d::Zero().eval()))), 1e-9);
  }
}

} // namespace
} // namespace vi_ekf_slam
