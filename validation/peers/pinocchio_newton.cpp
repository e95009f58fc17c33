// Configurations of a four-bar linkage by Newton's method in Pinocchio's C++; see by_pinocchio_cpp.py.
// Reads numbers from stdin and writes the processor time in seconds, then crank and rocker angles.
#include <cstdio>
#include <ctime>
#include <vector>

#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
namespace pin = pinocchio;

static double number() {
  double value;
  if (std::scanf("%lf", &value) != 1) { std::exit(2); }
  return value;
}

static Vector3d vector() {
  const double x = number(), y = number(), z = number();
  return {x, y, z};
}

static Matrix3d matrix() {
  Matrix3d rows;
  for (int i = 0; i < 3; i++) { rows.row(i) = vector().transpose(); }
  return rows;
}

static double seconds() {
  timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return now.tv_sec + 1e-9 * now.tv_nsec;
}

struct Linkage {
  pin::Model model;
  pin::Data data;
  pin::FrameIndex frames[2];
  int rows;
  Vector3d residual;
  MatrixXd jacobian, first, second;

  void linearise(const VectorXd &q) {
    pin::computeJointJacobians(model, data, q);
    pin::updateFramePlacement(model, data, frames[0]);
    pin::updateFramePlacement(model, data, frames[1]);
    first.setZero();
    second.setZero();
    pin::getFrameJacobian(model, data, frames[0], pin::LOCAL_WORLD_ALIGNED, first);
    pin::getFrameJacobian(model, data, frames[1], pin::LOCAL_WORLD_ALIGNED, second);
    residual = data.oMf[frames[0]].translation() - data.oMf[frames[1]].translation();
    jacobian = (first - second).topRows(rows);
  }

  // the smallest change x of all coordinates except the crank's with J x = right side
  VectorXd least_norm_step(const VectorXd &right_side) const {
    const MatrixXd dependent = jacobian.rightCols(model.nv - 1);
    VectorXd step = VectorXd::Zero(model.nv);
    step.tail(model.nv - 1) = dependent.transpose() * (dependent * dependent.transpose()).llt().solve(right_side);
    return step;
  }

  VectorXd tangent() const {
    VectorXd step = least_norm_step(-jacobian.col(0));
    step[0] = 1.0;
    return step;
  }
};

int main() {
  const bool planar = number() != 0;
  const int steps = int(number());
  const double tolerance = number();
  Linkage linkage;
  pin::Model &model = linkage.model;
  const auto placement = [] { const Matrix3d r = matrix(); return pin::SE3(r, vector()); };
  const auto crank = model.addJoint(0, pin::JointModelRZ(), placement(), "crank");
  const auto at = placement();
  const auto coupler = planar ? model.addJoint(crank, pin::JointModelRZ(), at, "coupler")
                              : model.addJoint(crank, pin::JointModelSpherical(), at, "coupler");
  const auto rocker = model.addJoint(0, pin::JointModelRZ(), placement(), "rocker");
  const pin::SE3 coupler_end(Matrix3d::Identity(), vector()), rocker_end(Matrix3d::Identity(), vector());
  linkage.frames[0] = model.addFrame(pin::Frame("coupler end", coupler, 0, coupler_end, pin::OP_FRAME));
  linkage.frames[1] = model.addFrame(pin::Frame("rocker end", rocker, 0, rocker_end, pin::OP_FRAME));
  linkage.data = pin::Data(model);
  linkage.rows = planar ? 2 : 3;
  linkage.first = linkage.second = MatrixXd::Zero(6, model.nv);
  VectorXd q(model.nq);
  for (int i = 0; i < model.nq; i++) { q[i] = number(); }
  const double start = q[0], step_angle = 2.0 * M_PI / steps;
  std::vector<double> angles{q[0], q[model.nq - 1]};
  const double begin = seconds();
  linkage.linearise(q);
  VectorXd tangent_vector = linkage.tangent();
  for (int i = 1; i <= steps; i++) {
    q = pin::integrate(model, q, VectorXd(step_angle * tangent_vector));
    q[0] = start + i * step_angle;
    for (int k = 0; k < 10; k++) {
      linkage.linearise(q);
      if (linkage.residual.head(linkage.rows).cwiseAbs().maxCoeff() < tolerance) { break; }
      q = pin::integrate(model, q, linkage.least_norm_step(-linkage.residual.head(linkage.rows)));
    }
    tangent_vector = linkage.tangent();
    angles.push_back(q[0]);
    angles.push_back(q[model.nq - 1]);
  }
  std::printf("%.9g\n", seconds() - begin);
  for (const double angle : angles) { std::printf("%.17g\n", angle); }
  return 0;
}
