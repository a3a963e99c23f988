#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/filter/compressed_core.hpp"
#include "vi_ekf_slam/core/filter/inactive_store.hpp"
#include "vi_ekf_slam/core/filter/innovation.hpp"
#include "vi_ekf_slam/core/filter/variables.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// How the core moves from one stamp to the next: its errors [row, row + k) become F (k x w) times the errors
/// [row, row + w), and those from `row` on get noise of covariance Q; the pose, and means of other core
/// variables.
struct CoreStep {
  Eigen::Index row = 0;
  CoreSquare F, Q;
  SE3 pose;
  std::vector<std::pair<Handle, SmallVector>> means;
};

/// An extended Kalman filter over variables of any number and size. It owns mean and joint covariance, which
/// change through four operations alone: propagate, augment, correct, and remove (or deactivate). Knows no
/// camera, no IMU and no policy.
///
/// The first variables are the core: those that move, from the pose on, and that are measured often. A period
/// in which only the core takes part is compressed (CompressedCore), and applied to the rest when anything
/// else is asked for. Variables that take part in nothing for long can be made inactive (InactiveStore).
class Filter {
 public:
  /// At `pose`, known to `covariance` (6x6 of (dp, theta)).
  Filter(const SE3& pose, const Matrix6d& covariance);

  // Means and covariance. While a period of the core is under way, that of the core alone is of now; settle
  // brings everything up to date.
  const Variables& variables() const { return variables_; }
  const SE3& pose() const { return variables_.pose(); }
  const InactiveStore& inactive() const { return inactive_; }
  Eigen::Index rows() const { return variables_.rows(); }
  Eigen::Index rowOf(Handle handle) const { return variables_.rowOf(handle); }
  Eigen::Index coreRows() const { return core_rows_; }
  /// rows() square, symmetric.
  auto covariance() const { return covariance_.topLeftCorner(rows(), rows()); }
  bool isLevel() const { return variables_.isLevel(); }
  /// Of two variables' errors.
  Eigen::MatrixXd covariance(Handle a, Handle b) const;
  Eigen::MatrixXd covariance(Handle a) const { return covariance(a, a); }
  /// Of a point's error along the world axes, x - x^ (3x3, m^2).
  Eigen::Matrix3d worldCovariance(Handle point) const;
  /// Ends a period of the core.
  void settle();

  // 1. Propagate. Whatever is not of the core stays where it is in the world.
  void propagate(const CoreStep& step);
  /// The variables behind the core move by G x (rows() - coreRows() by k) of a core variable x.
  void moveRest(Handle by, const Eigen::MatrixXd& G);
  /// The errors of these rows gain independent noise (k x k), such as a point that slides.
  void addNoise(Eigen::Index row, const Eigen::Ref<const Eigen::MatrixXd>& noise);

  // 2. Augment. A new variable's error is J x + noise (k x k), with J x of some rows, or that noise alone. A
  // saved map knows it by its `name`; without one it is not saved.
  Handle augment(Chart chart, const Eigen::VectorXd& mean, const Eigen::Ref<const Eigen::MatrixXd>& noise,
                 const LinearFunction& by = {}, const std::string& name = {});
  /// The variables there are now are the core. Once, at the start.
  void closeCore();

  // 3. Correct. False, and no change, where S is not positive definite or something is not finite.
  bool correct(const LinearMeasurement& measurement);
  /// `in` is of this filter's covariance, settled, and factorised; points are moved as `chart` has it.
  bool correct(const Innovation& in, const PointChart& chart = {});

  // 4. Remove.
  void remove(Handle handle);
  /// Keeps a variable's mean and correlation out of the way; its handle stays.
  void deactivate(Handle handle);
  /// A new inactive variable is the pose of now, with errors (dp, theta) along the world axes: its mean is
  /// the position, and how the pose is turned by later corrections (rad, world).
  Handle clonePose();
  /// Brings inactive variables back, as the last rows, in the order in which they left. Throws
  /// std::out_of_range, and brings none, where one is not inactive.
  void activate(const std::vector<Handle>& handles);
  std::vector<Handle> marginaliseOldest(std::size_t count);
  /// Does what is deferred for the inactive variables.
  void settleInactive() {
    settle();
    inactive_.settle();
  }
  /// The same in a thread, see InactiveStore.
  void beginSettlingInactive() { inactive_.beginSettling(); }
  void endSettlingInactive() { inactive_.endSettling(); }

  /// The errors of these rows of the core are new ones, of this covariance (k x k) and independent of all
  /// others: of a variable that is unknown again, or of a coordinate of the pose that says where the world
  /// is.
  void makeIndependent(Eigen::Index row, const Eigen::Ref<const Eigen::MatrixXd>& covariance);
  /// Another world frame: all is at to_T_world of where it was. Throws std::logic_error where variables are
  /// inactive.
  void moveWorld(const SE3& to_T_world);
  /// For a filter that goes on from what another one knew, before anything is added to its core: where it is,
  /// and the core's covariance (c x c).
  void begin(const SE3& pose) { variables_.setPose(pose); }
  template <class Vector>
  void setMean(Handle handle, const Vector& mean) {
    variables_.mean(handle) = mean;
  }
  void setCoreCovariance(const Eigen::Ref<const Eigen::MatrixXd>& covariance);
  /// Points from elsewhere take the place of the inactive variables: `covariance` of their errors along the
  /// world axes, independent of the active ones, or `cross` (rows() x 3k) with these.
  std::vector<Handle> adopt(const std::vector<Eigen::Vector3d>& points, const Eigen::MatrixXd& covariance,
                            Eigen::MatrixXd cross);

 private:
  Eigen::Ref<Eigen::MatrixXd> P() { return covariance_.topLeftCorner(rows(), rows()); }
  Eigen::MatrixXd poseInfluence(const Eigen::Vector3d& position) const;
  /// The core's columns, and of others' rows as many as make them whole vectors of the processor.
  auto paddedCore() { return covariance_.topLeftCorner(core_.padded(), core_rows_); }
  template <int kRows>
  bool correctCore(const LinearMeasurement& z);
  void endPeriod(const Eigen::MatrixXd& G, Handle by);
  void moveInactive(const std::vector<InactiveStore::Estimate>& before);
  void erase(const Variables::Gone& gone, Eigen::Index rows_before);
  void reserve(Eigen::Index rows);

  Variables variables_;
  Eigen::MatrixXd covariance_; ///< with room for more
  Eigen::Index core_rows_ = 0;
  CompressedCore core_{0};
  InactiveStore inactive_;
};

/// What the pose's error (dp, theta) does to y of a point that stays where it is in the world, of error d:
/// y = d + [-I, [x - p]x] (dp, theta).
Eigen::Matrix<double, 3, 6> byPose(const Eigen::Vector3d& point, const Eigen::Vector3d& position);

} // namespace vi_ekf_slam
