// SPDX-License-Identifier: Apache-2.0
// Adjusts a 2D pose graph with Ceres; pose_graph_driver.h describes the commands.
//
// Methods: sparse_normal_cholesky (as in Cartographer), dense_schur and sparse_schur, which
// use Levenberg-Marquardt; with the suffix _gauss_newton, without damping.

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>

#include "pose_graph_driver.h"

namespace {

// Equation (5) of the paper, whitened, with its derivatives.
class RelativePose : public ceres::SizedCostFunction<3, 3, 3> {
 public:
  RelativePose(const double* measured, const double* whitening)
      : measured_(measured), whitening_(whitening) {}

  bool Evaluate(double const* const* poses, double* residuals, double** jacobians) const override {
    const double* a = poses[0];
    const double* b = poses[1];
    const double cos_a = std::cos(a[2]), sin_a = std::sin(a[2]);
    const double dx = b[0] - a[0], dy = b[1] - a[1];
    const double seen_x = cos_a * dx + sin_a * dy, seen_y = cos_a * dy - sin_a * dx;
    double turn = measured_[2] - (b[2] - a[2]);
    turn -= 2.0 * M_PI * std::floor((turn + M_PI) / (2.0 * M_PI));
    const double error[3] = {measured_[0] - seen_x, measured_[1] - seen_y, turn};
    for (int i = 0; i < 3; ++i) {
      const double* w = whitening_ + 3 * i;
      residuals[i] = w[0] * error[0] + w[1] * error[1] + w[2] * error[2];
    }
    if (jacobians != nullptr) {
      const double by_a[9] = {cos_a, sin_a, -seen_y, -sin_a, cos_a, seen_x, 0.0, 0.0, 1.0};
      const double by_b[9] = {-cos_a, -sin_a, 0.0, sin_a, -cos_a, 0.0, 0.0, 0.0, -1.0};
      Whiten(by_a, jacobians[0]);
      Whiten(by_b, jacobians[1]);
    }
    return true;
  }

 private:
  void Whiten(const double* matrix, double* out) const {
    if (out == nullptr) return;
    for (int i = 0; i < 3; ++i) {
      const double* w = whitening_ + 3 * i;
      for (int j = 0; j < 3; ++j) {
        out[3 * i + j] = w[0] * matrix[j] + w[1] * matrix[3 + j] + w[2] * matrix[6 + j];
      }
    }
  }

  const double* measured_;
  const double* whitening_;
};

class CeresSolver : public PoseGraphSolver {
 public:
  explicit CeresSolver(const Graph& graph)
      : graph_(graph), poses_(graph.start), huber_(graph.huber_scale), problem_(KeepLoss()) {
    for (int64_t e = 0; e < graph.num_edges; ++e) {
      problem_.AddResidualBlock(
          new RelativePose(&graph.measured[3 * e], &graph.whitening[9 * e]),
          graph.is_robust[e] ? &huber_ : nullptr, Pose(graph.a[e]), Pose(graph.b[e]));
    }
    for (const int64_t vertex : graph.held) {
      if (problem_.HasParameterBlock(Pose(vertex))) {
        problem_.SetParameterBlockConstant(Pose(vertex));
      }
    }
  }

  bool Solve(const std::string& method, Answer* answer) override {
    ceres::Solver::Options options;
    if (!SetMethod(method, &options)) return false;
    options.max_num_iterations = static_cast<int>(graph_.max_iterations);
    options.function_tolerance = graph_.tolerance;  // the only stopping rule
    options.gradient_tolerance = 0.0;
    options.parameter_tolerance = 0.0;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    std::copy(graph_.start.begin(), graph_.start.end(), poses_.begin());
    ceres::Solver::Summary summary;
    answer->seconds = SecondsOf([&] { ceres::Solve(options, &problem_, &summary); });
    answer->iterations = summary.num_linear_solves;
    answer->is_usable = summary.IsSolutionUsable();
    return true;
  }

  std::vector<double> Poses() const override { return poses_; }

 private:
  static ceres::Problem::Options KeepLoss() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  double* Pose(int64_t vertex) { return &poses_[3 * vertex]; }

  bool SetMethod(const std::string& method, ceres::Solver::Options* options) {
    const std::string undamped = "_gauss_newton";
    const size_t end = method.rfind(undamped);
    if (end != std::string::npos) {
      options->initial_trust_region_radius = options->max_trust_region_radius = 1e16;
    }
    const std::string solver = method.substr(0, end);
    if (!ceres::StringToLinearSolverType(solver, &options->linear_solver_type)) return false;
    if (solver != "sparse_normal_cholesky" && !graph_.eliminated.empty()) {
      auto* ordering = new ceres::ParameterBlockOrdering;  // the options own it
      std::vector<double*> blocks;
      problem_.GetParameterBlocks(&blocks);
      for (double* block : blocks) ordering->AddElementToGroup(block, 1);
      for (const int64_t vertex : graph_.eliminated) {
        if (ordering->IsMember(Pose(vertex))) ordering->AddElementToGroup(Pose(vertex), 0);
      }
      options->linear_solver_ordering.reset(ordering);
    }
    return true;
  }

  const Graph& graph_;
  std::vector<double> poses_;
  ceres::HuberLoss huber_;
  ceres::Problem problem_;
};

}  // namespace

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  Graph graph;
  if (argc != 2 || !ReadGraph(argv[1], &graph)) {
    std::cerr << "ceres_pose_graph: give the file of a graph, as compiled_drivers.py writes it\n";
    return 1;
  }
  CeresSolver solver(graph);
  return Serve(&solver);
}
