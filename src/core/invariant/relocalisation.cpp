// How InvariantEstimator finds its place in a loaded map, by ids that return.

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <optional>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"
#include "vi_ekf_slam/core/invariant/jump.hpp"
#include "vi_ekf_slam/core/invariant/saved_joint.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kTellingObservations = 3; // of a landmark in view
constexpr std::size_t kLeastMatches = 6, kMostPoints = 100;
constexpr std::size_t kLeastFused = 5;
constexpr int kFramesBetweenTries = 5;     // attempts
constexpr int kFramesBetweenFailures = 50; // of the costly part
constexpr double kCornerSigma = 0.05;      // m, by which a front end finds a corner elsewhere another time
constexpr double kCompatible = 11.345;     // chi-square, 3 degrees of freedom, 99 %
constexpr double kShareOfMatches = 0.6;    // of the matches, that must agree
constexpr double kLeastWidth = 0.5;        // m, of the points beside the line that they are nearest to
// Where the drive is in the map is not known beforehand, so that the landmarks alone tell. m, rad.
constexpr double kAnyPosition = 1e3, kAnyRotation = 2.0;

Eigen::Vector3d centreOf(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) centre += p / static_cast<double>(points.size());
  return centre;
}

/// What shifting and turning all points (about their centre) by (dt, dphi) does to each: [I, -[p - c]x].
Eigen::MatrixXd rigidMotions(const std::vector<Eigen::Vector3d>& points) {
  const Eigen::Vector3d centre = centreOf(points);
  Eigen::MatrixXd G(3 * static_cast<Eigen::Index>(points.size()), 6);
  for (std::size_t i = 0; i < points.size(); ++i)
    G.middleRows<3>(3 * static_cast<Eigen::Index>(i)) << Eigen::Matrix3d::Identity(),
        -so3::hat(points[i] - centre);
  return G;
}

/// The covariance (3x3 each) of points beside the motion of all of them as one rigid body, as it is told from
/// those of large weight, of their joint covariance C (3n x 3n): of (I - G (G^T W G)^-1 G^T W) C (...)^T.
std::vector<Eigen::Matrix3d> shapeCovariances(const std::vector<Eigen::Vector3d>& points, Eigen::MatrixXd C,
                                              const Eigen::VectorXd& weights) {
  const Eigen::MatrixXd G = rigidMotions(points), WG = weights.asDiagonal() * G;
  const Matrix6d information = G.transpose() * WG;
  const Eigen::MatrixXd A =
      information.ldlt().solve(G.transpose()).transpose(); // singular, if all are in a line
  const Eigen::MatrixXd GWC = WG.transpose() * C;
  C.noalias() -= A * GWC;
  const Eigen::MatrixXd CWG = C * WG;
  C.noalias() -= CWG * A.transpose();
  std::vector<Eigen::Matrix3d> own;
  for (Eigen::Index row = 0; row < C.rows(); row += 3) {
    const Eigen::Matrix3d block = C.block<3, 3>(row, row);
    own.push_back(0.5 * (block + block.transpose()));
  }
  return own;
}

/// The 3x3 blocks of P at these rows.
Eigen::MatrixXd blocksOf(const Eigen::Ref<const Eigen::MatrixXd>& P, const std::vector<Eigen::Index>& rows) {
  const auto n = static_cast<Eigen::Index>(rows.size());
  Eigen::MatrixXd C(3 * n, 3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j)
      C.block<3, 3>(3 * i, 3 * j) =
          P.block<3, 3>(rows[static_cast<std::size_t>(i)], rows[static_cast<std::size_t>(j)]);
  }
  return C;
}

/// Landmarks that are here (in this drive's frame) and there (in the map's), with the joint covariance of
/// their errors in either frame (3n x 3n).
struct Matches {
  std::vector<FeatureId> ids;
  std::vector<Eigen::Vector3d> here, there;
  Eigen::MatrixXd covariance_here, covariance_there;
  Eigen::VectorXd weights; ///< 3n, 1/m^2: how well each is known from the vehicle

  void keep(const std::vector<std::size_t>& chosen) {
    Matches kept;
    std::vector<Eigen::Index> rows;
    for (const std::size_t i : chosen) {
      kept.ids.push_back(ids[i]);
      kept.here.push_back(here[i]);
      kept.there.push_back(there[i]);
      rows.push_back(3 * static_cast<Eigen::Index>(i));
    }
    kept.covariance_here = blocksOf(covariance_here, rows);
    kept.covariance_there = blocksOf(covariance_there, rows);
    *this = std::move(kept);
  }
};

/// The rigid transform there_T_here on which most of them agree, whatever the others are.
std::optional<SE3> roughAlignment(const Matches& m) {
  const auto shape_here = shapeCovariances(m.here, m.covariance_here, m.weights);
  const auto shape_there = shapeCovariances(m.there, m.covariance_there, m.weights);
  std::vector<Displaced> points;
  for (std::size_t i = 0; i < m.ids.size(); ++i) {
    // How the one is turned against the other is not known yet: the largest of its variances in every
    // direction.
    const double variance = shape_here[i].selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff();
    points.push_back(
        {m.there[i], m.here[i],
         shape_there[i] + (variance + kCornerSigma * kCornerSigma) * Eigen::Matrix3d::Identity()});
  }
  return commonMotion(points);
}

/// Leaves out the match that contradicts the others most, under the joint covariance, until none does; the
/// others' transform is `there_T_here` from then on. With S the covariance of what is left of all, and r =
/// S^-1 innovation, what one of them is off by, given the others, has the chi-square r_i^T ((S^-1)_ii)^-1
/// r_i.
void keepCompatible(Matches& m, SE3& there_T_here) {
  while (m.ids.size() >= kLeastMatches) {
    const auto n = 3 * static_cast<Eigen::Index>(m.ids.size());
    std::vector<Eigen::Vector3d> moved;
    Eigen::VectorXd innovation(n);
    for (std::size_t i = 0; i < m.ids.size(); ++i) {
      moved.push_back(there_T_here * m.here[i]);
      innovation.segment<3>(3 * static_cast<Eigen::Index>(i)) = m.there[i] - moved[i];
    }
    const Eigen::Matrix3d& R = there_T_here.rotation();
    Eigen::MatrixXd S = m.covariance_there;
    for (Eigen::Index i = 0; i < n; i += 3) {
      for (Eigen::Index j = 0; j < n; j += 3)
        S.block<3, 3>(i, j) += R * m.covariance_here.block<3, 3>(i, j) * R.transpose();
    }
    S.diagonal().array() += kCornerSigma * kCornerSigma;
    const Eigen::MatrixXd G = rigidMotions(moved);
    Vector6d any;
    any << Eigen::Vector3d::Constant(kAnyPosition), Eigen::Vector3d::Constant(kAnyRotation);
    const Eigen::MatrixXd prior = G * any.cwiseAbs2().asDiagonal();
    S.noalias() += prior * G.transpose();
    const Eigen::MatrixXd inverse = S.llt().solve(Eigen::MatrixXd::Identity(n, n));
    const Eigen::VectorXd r = inverse * innovation;
    std::vector<std::size_t> others;
    std::size_t worst = 0;
    double most = 0.0;
    for (std::size_t i = 0; i < m.ids.size(); ++i) {
      const Eigen::Index row = 3 * static_cast<Eigen::Index>(i);
      const Eigen::Vector3d own = r.segment<3>(row);
      const double chi_square = squaredMahalanobis(own, inverse.block<3, 3>(row, row));
      if (chi_square > most) {
        most = chi_square;
        worst = i;
      }
    }
    const Vector6d motion = prior.transpose() * r; // the transform's error, as the matches have it
    const Eigen::Vector3d centre = centreOf(moved);
    const Eigen::Matrix3d turn = so3::Exp(motion.tail<3>());
    there_T_here = (SE3(turn, centre - turn * centre + motion.head<3>()) * there_T_here).normalized();
    if (!(most > kCompatible)) return;
    for (std::size_t i = 0; i < m.ids.size(); ++i) {
      if (i != worst) others.push_back(i);
    }
    m.keep(others);
  }
}

/// Whether the points tell how they are turned: they are not all near one line.
bool spanAPlane(const std::vector<Eigen::Vector3d>& points) {
  const Eigen::Vector3d centre = centreOf(points);
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points)
    scatter += (p - centre) * (p - centre).transpose() / static_cast<double>(points.size());
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvalues()[1] > kLeastWidth * kLeastWidth;
}

} // namespace

void InvariantEstimator::relocaliseIn(std::shared_ptr<const SavedMap> map) {
  LoadedMap loaded{std::move(map), {}, 0};
  for (std::size_t i = 0; i < loaded.map->landmarks.size(); ++i)
    loaded.index.emplace(loaded.map->landmarks[i].id, i);
  loaded_ = std::move(loaded);
  map_use_ = MapUse::kWaiting;
}

/// The drive so far is in a frame of its own. When landmarks in view have ids of the map and their
/// constellation is the map's, all is moved there; where they do not agree it goes on as if nothing had been
/// tried.
void InvariantEstimator::relocalise(FrameReport& report) {
  if (--loaded_->frames_until_attempt > 0) return;
  loaded_->frames_until_attempt = kFramesBetweenTries;
  SE3 map_T_session;
  const std::vector<FeatureId> ids = agreeingWithMap(map_T_session);
  if (ids.size() < kLeastMatches) return;
  if (!moveIntoMap(map_T_session, ids)) {
    loaded_->frames_until_attempt = kFramesBetweenFailures;
    return;
  }
  report.relocalised = true;
  loaded_.reset();
  map_use_ = MapUse::kRelocalised;
}

/// Ids of landmarks in view that lie in the map as they lie here, and how the one lies in the other; none
/// where too few do.
std::vector<FeatureId> InvariantEstimator::agreeingWithMap(SE3& map_T_session) const {
  const SavedMap& map = *loaded_->map;
  Matches m;
  std::vector<Eigen::Index> rows_here, rows_there;
  for (std::size_t i = 0; i < state_.landmarks().size() && m.ids.size() < kMostPoints; ++i) {
    const Landmark& l = state_.landmarks()[i];
    const auto known = loaded_->index.find(l.id);
    if (l.observations < kTellingObservations || l.anchored || known == loaded_->index.end()) continue;
    m.ids.push_back(l.id);
    m.here.push_back(l.position);
    m.there.push_back(map.landmarks[known->second].position);
    rows_here.push_back(State::offsetOf(i));
    rows_there.push_back(State::offsetOf(known->second));
  }
  const std::size_t matches = m.ids.size();
  if (matches < kLeastMatches) return {};
  m.covariance_here = blocksOf(state_.covariance(), rows_here);
  m.covariance_there = blocksOf(map.covariance, rows_there);
  m.weights.resize(3 * static_cast<Eigen::Index>(matches));
  for (std::size_t i = 0; i < matches; ++i) {
    const double variance =
        state_.relativeCovariance(rows_here[i]).trace() / 3.0 + kCornerSigma * kCornerSigma;
    m.weights.segment<3>(3 * static_cast<Eigen::Index>(i)).setConstant(1.0 / variance);
  }
  const auto motion = roughAlignment(m);
  if (!motion) return {};
  map_T_session = *motion;
  keepCompatible(m, map_T_session);
  const bool enough = m.ids.size() >= kLeastMatches &&
                      static_cast<double>(m.ids.size()) >= kShareOfMatches * static_cast<double>(matches);
  return enough && spanAPlane(m.there) ? m.ids : std::vector<FeatureId>();
}

/// Moves the state into the map's frame, as unsure of where it is there as can be, and fuses its landmarks of
/// these ids with the map's, which tells. False, and no change, where these contradict the joint covariance.
/// What this drive saw before stays in the map as estimates without correlation.
bool InvariantEstimator::moveIntoMap(const SE3& map_T_session, const std::vector<FeatureId>& ids) {
  State before = state_;
  const bool loop_closed = loop_closed_;
  auto recalled = std::exchange(recalled_, {});
  auto disputed = std::exchange(disputed_, {});
  state_.marginaliseOldest(state_.inactive().size());
  for (std::size_t i = state_.landmarks().size(); i-- > 0;) {
    if (state_.landmarks()[i].anchored) state_.removeLandmark(i); // recalled, and not seen since
  }
  state_.moveWorld(map_T_session);
  Vector6d any;
  any << Eigen::Vector3d::Constant(kAnyPosition), Eigen::Vector3d::Constant(kAnyRotation);
  // Turning by w about p: xi_R = w, xi_p = [p]x w.
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = so3::hat(state_.pose().translation());
  state_.loosen(J * any.cwiseAbs2().asDiagonal() * J.transpose());
  State::Joint joint = jointOf(*loaded_->map);
  const Eigen::Index k3 = joint.covariance.rows() - kLandmarks;
  state_.adopt(std::move(joint.landmarks), joint.covariance.bottomRightCorner(k3, k3));
  if (fuseReturned(ids, kLeastFused) < kLeastFused || !isSound(true)) {
    state_ = std::move(before);
    recalled_ = std::move(recalled);
    disputed_ = std::move(disputed);
    loop_closed_ = loop_closed;
    return false;
  }
  for (const InactiveLandmark& l : before.inactiveLandmarks(InactiveMap::Covariances::kLastSettled))
    archive_.put({l.landmark.id, l.landmark.position, l.covariance});
  Matrix6d turned = Matrix6d::Zero(); // the error of the pose within this drive, along the map's axes
  for (const Eigen::Index at : {0, 3}) turned.block<3, 3>(at, at) = map_T_session.rotation();
  const Matrix6d own = turned * before.poseCovariance() * turned.transpose();
  archive_.move(map_T_session, state_.pose().translation(), 2.0 * (own + state_.poseCovariance()));
  drift_ = Drift(config_.drift_position, config_.drift_rotation);
  return true;
}

} // namespace vi_ekf_slam::invariant
