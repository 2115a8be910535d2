// SPDX-License-Identifier: Apache-2.0
// The common part of the drivers of foreign solvers: the graph file and the commands.
//
//   DRIVER GRAPH
//
// GRAPH is what compiled_drivers.py writes: native int64 and double in the order of Graph below. Then, line
// by line on standard input:
//
//   solve METHOD   solves from the start in GRAPH, and answers with a line of JSON: seconds of
//                  solving alone, linear systems solved, and whether the result is usable
//   poses FILE     writes the poses found last as doubles (x, y, theta) into FILE

#ifndef CARTOLOOP_BENCH_POSE_GRAPH_DRIVER_H_
#define CARTOLOOP_BENCH_POSE_GRAPH_DRIVER_H_

#include <chrono>
#include <cstdint>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

struct Graph {
  int64_t num_vertices, num_edges, num_held, num_eliminated, max_iterations;
  double huber_scale, tolerance;
  std::vector<int64_t> held, eliminated, a, b, is_robust;
  std::vector<double> start;      // num_vertices x 3
  std::vector<double> measured;   // num_edges x 3: pose of b in a
  std::vector<double> whitening;  // num_edges x 3 x 3, by rows: W with W^T W = information
};

struct Answer {
  double seconds;
  int64_t iterations;
  bool is_usable;
};

class PoseGraphSolver {
 public:
  virtual ~PoseGraphSolver() = default;
  // Returns false if there is no such method.
  virtual bool Solve(const std::string& method, Answer* answer) = 0;
  // num_vertices x 3, of the last solution.
  virtual std::vector<double> Poses() const = 0;
};

template <typename T>
void Read(std::istream& in, int64_t count, std::vector<T>* values) {
  values->resize(count);
  in.read(reinterpret_cast<char*>(values->data()), count * static_cast<int64_t>(sizeof(T)));
}

inline bool ReadGraph(const std::string& path, Graph* graph) {
  std::ifstream in(path, std::ios::binary);
  std::vector<int64_t> counts;
  std::vector<double> limits;
  Read(in, 5, &counts);
  Read(in, 2, &limits);
  if (!in) return false;
  graph->num_vertices = counts[0];
  graph->num_edges = counts[1];
  graph->num_held = counts[2];
  graph->num_eliminated = counts[3];
  graph->max_iterations = counts[4];
  graph->huber_scale = limits[0];
  graph->tolerance = limits[1];
  Read(in, graph->num_held, &graph->held);
  Read(in, graph->num_eliminated, &graph->eliminated);
  Read(in, graph->num_edges, &graph->a);
  Read(in, graph->num_edges, &graph->b);
  Read(in, graph->num_edges, &graph->is_robust);
  Read(in, graph->num_vertices * 3, &graph->start);
  Read(in, graph->num_edges * 3, &graph->measured);
  Read(in, graph->num_edges * 9, &graph->whitening);
  return static_cast<bool>(in);
}

template <typename Function>
double SecondsOf(const Function& function) {
  const auto begin = std::chrono::steady_clock::now();
  function();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

// Runs the commands on standard input; returns the exit status.
inline int Serve(PoseGraphSolver* solver) {
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream words(line);
    std::string command, argument;
    words >> command >> argument;
    if (command == "poses") {
      const std::vector<double> poses = solver->Poses();
      std::ofstream out(argument, std::ios::binary);
      out.write(reinterpret_cast<const char*>(poses.data()),
                static_cast<int64_t>(poses.size() * sizeof(double)));
      out.close();
      std::cout << "{\"is_written\": " << (out ? "true" : "false") << "}" << std::endl;
      continue;
    }
    Answer answer{};
    if (command != "solve" || !solver->Solve(argument, &answer)) {
      std::cerr << "cannot do '" << line << "'\n";
      return 1;
    }
    std::cout << "{\"seconds\": " << answer.seconds << ", \"iterations\": " << answer.iterations
              << ", \"is_usable\": " << (answer.is_usable ? "true" : "false") << "}" << std::endl;
  }
  return 0;
}

#endif  // CARTOLOOP_BENCH_POSE_GRAPH_DRIVER_H_
