/* FMI 3.0, co-simulation: the functions of the interface around two functions of CasADi,
 *
 *   advance(x, u, p, h) -> x after a step h (s) at constant inputs u, and an estimate of its error
 *   observe(x, u, p) -> y
 *
 * A value reference is the index in time, p, x, u, y, one after the other.  PARAMETERS, STATES, INPUTS, OUTPUTS,
 * TOLERANCE, TOKEN, the sizes of the work arrays and the values at the start are defined above.  The functions of the
 * interface that this FMU does not have follow at the end.
 *
 * Each instance has its own memory.  Steps h follow from the error and the tolerance.  A communication step changes
 * the state only when it has reached its end.
 */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "fmi3Functions.h"

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

enum { P = 1, X = P + PARAMETERS, U = X + STATES, Y = U + INPUTS, VALUES = Y + OUTPUTS };

#define SMALLEST_STEP 1e-9 /* of the communication step */
#define MOST_STEPS 20000   /* in a communication step; test_co_simulation.py */

typedef enum { INSTANTIATED, INITIALIZING, STEPPING, ENDED } Phase;

typedef struct {
  Phase phase;
  int outdated; /* the outputs */
  double tolerance, h, value[VALUES];
} State;

typedef struct {
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;
  fmi3Boolean logging;
  State state;
  double motion, seconds; /* duration of all steps, and their processor time */
  long long accepted, rejected;
  const double* arg[WORK_ARG];
  double* res[WORK_RES];
  casadi_int iw[WORK_IW];
  double w[WORK_W];
} Instance;

static fmi3Status say(Instance* own, fmi3Status status, const char* format, ...) {
  char message[400];
  va_list values;
  va_start(values, format);
  vsnprintf(message, sizeof message, format, values);
  va_end(values);
  if (own->log && (own->logging || status != fmi3OK))
    own->log(own->environment, status, status == fmi3OK ? "logStatus" : "logStatusError", message);
  return status;
}

static fmi3Status refuse(Instance* own) { return say(own, fmi3Error, "this function is not part of the FMU"); }

static int all_finite(const double* values, int count) {
  int k;
  for (k = 0; k < count; ++k)
    if (!isfinite(values[k])) return 0;
  return 1;
}

static void start(Instance* own) {
  memset(&own->state, 0, sizeof own->state);
  own->state.tolerance = TOLERANCE;
  own->state.outdated = 1;
  memcpy(own->state.value + P, at_start, sizeof at_start);
  own->motion = own->seconds = 0.0;
  own->accepted = own->rejected = 0;
}

/* Integrate to a time; return 0 if no step converges, and the time reached in value[0]. */
static int integrate(Instance* own, State* s, double end) {
  int repeated = 0, count = 0;
  const double smallest = SMALLEST_STEP * (end - s->value[0]);
  double next[STATES], error;
  if (s->h == 0.0) s->h = end - s->value[0];
  while (s->value[0] < end) {
    const double left = end - s->value[0];
    double h = s->h, factor;
    int converged;
    if (h < left && 2 * h > left) h = left / 2;
    if (h > left) h = left;
    own->arg[0] = s->value + X;
    own->arg[1] = s->value + U;
    own->arg[2] = s->value + P;
    own->arg[3] = &h;
    own->res[0] = next;
    own->res[1] = &error;
    converged = !advance(own->arg, own->res, own->iw, own->w, 0) && isfinite(error) && all_finite(next, STATES);
    error /= s->tolerance;
    factor = converged ? fmin(repeated ? 1.0 : 5.0, fmax(0.2, 0.9 * pow(error + 1e-12, -0.2))) : 0.2;
    if (++count > MOST_STEPS) return 0;
    if (!converged || error > 1.0) {
      ++own->rejected;
      repeated = 1;
      s->h = h * factor;
      if (s->h < smallest) return 0;
      continue;
    }
    ++own->accepted;
    repeated = 0;
    memcpy(s->value + X, next, sizeof next);
    s->value[0] = h == left ? end : s->value[0] + h;
    s->h = factor < 1.0 ? h * factor : fmax(s->h, h * factor); /* h may have been cut at the end */
  }
  return 1;
}

const char* fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
  Instance* own = calloc(1, sizeof(Instance));
  if (!own) return NULL;
  own->environment = environment;
  own->log = log;
  own->logging = logging;
  start(own);
  if (!token || strcmp(token, TOKEN)) {
    say(own, fmi3Error, "the instantiation token is that of another FMU; read modelDescription.xml of this one");
  } else if (events || count) {
    say(own, fmi3Error, "the FMU has no event mode and no intermediate variables; do not ask for them");
  } else {
    return own;
  }
  free(own);
  return NULL;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String categories[]) {
  ((Instance*)instance)->logging = on;
  return fmi3OK;
}

static fmi3Status enter(Instance* own, Phase from, Phase to) {
  if (own->state.phase != from) return say(own, fmi3Error, "this function cannot be called now; follow FMI 3.0");
  own->state.phase = to;
  return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
    fmi3Float64 begin, fmi3Boolean has_end, fmi3Float64 end) {
  Instance* own = instance;
  if (has_tolerance && !(tolerance > 0.0 && tolerance < 1.0))
    return say(own, fmi3Error, "the tolerance must be between 0 and 1, got %g", tolerance);
  if (enter(own, INSTANTIATED, INITIALIZING)) return fmi3Error;
  if (has_tolerance) own->state.tolerance = tolerance;
  own->state.value[0] = begin;
  return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { return enter(instance, INITIALIZING, STEPPING); }

fmi3Status fmi3Terminate(fmi3Instance instance) {
  Instance* own = instance;
  say(own, fmi3OK, "%g s of motion in %.3g s, %.3g times real time; steps: %lld, repeated: %lld", own->motion,
      own->seconds, own->motion / fmax(own->seconds, 1e-6), own->accepted, own->rejected);
  own->state.phase = ENDED;
  return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
  start(instance);
  return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
    fmi3Float64 values[], size_t size) {
  Instance* own = instance;
  State* s = &own->state;
  size_t k;
  if (count != size) return say(own, fmi3Error, "there must be one value for each reference");
  for (k = 0; k < count; ++k) {
    if (references[k] >= VALUES) return say(own, fmi3Error, "there is no variable %u", (unsigned)references[k]);
    if (references[k] >= Y && s->outdated) {
      own->arg[0] = s->value + X;
      own->arg[1] = s->value + U;
      own->arg[2] = s->value + P;
      own->res[0] = s->value + Y;
      if (observe(own->arg, own->res, own->iw, own->w, 0) || !all_finite(s->value + Y, OUTPUTS))
        return say(own, fmi3Error, "at %.9g s the outputs are not finite; check parameters and start", s->value[0]);
      s->outdated = 0;
    }
    values[k] = s->value[references[k]];
  }
  return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
    const fmi3Float64 values[], size_t size) {
  Instance* own = instance;
  State* s = &own->state;
  size_t k;
  if (count != size) return say(own, fmi3Error, "there must be one value for each reference");
  for (k = 0; k < count; ++k) {
    const unsigned reference = references[k];
    if (reference < P || reference >= Y) return say(own, fmi3Error, "variable %u cannot be set", reference);
    if (reference >= X && reference < U && s->phase > INITIALIZING)
      return say(own, fmi3Error, "variable %u is a state, and can be set before the first step only", reference);
    if (!isfinite(values[k])) return say(own, fmi3Error, "variable %u must be finite", reference);
  }
  for (k = 0; k < count; ++k) s->value[references[k]] = values[k];
  s->outdated = 1;
  return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 point, fmi3Float64 step, fmi3Boolean no_return,
    fmi3Boolean* events, fmi3Boolean* terminate, fmi3Boolean* early, fmi3Float64* reached) {
  Instance* own = instance;
  State next = own->state;
  const double now = next.value[0];
  const clock_t began = clock();
  int done;
  *events = *terminate = *early = fmi3False;
  *reached = now;
  if (next.phase != STEPPING) return say(own, fmi3Error, "a step needs an FMU that is initialized and has not failed");
  if (!(step > 0.0) || !isfinite(step)) return say(own, fmi3Error, "the step must be positive, got %g s", step);
  if (!(fabs(point - now) <= 1e-9 * fabs(now) + 1e-6 * step))
    return say(own, fmi3Error, "the FMU is at %.9g s, and cannot make a step from %.9g s", now, point);
  done = integrate(own, &next, point + step);
  own->seconds += (double)(clock() - began) / CLOCKS_PER_SEC;
  if (!done) {
    own->state.phase = ENDED;
    return say(own, fmi3Error, "at %.9g s no step converges, or too short ones of %.1e s; check inputs and parameters for values "
        "that no beam can bear, or choose shorter communication steps; the state is that at %.9g s",
        next.value[0], next.h, now);
  }
  own->motion += step;
  next.outdated = 1;
  own->state = next;
  *reached = next.value[0];
  return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState* state) {
  if (!*state) *state = malloc(sizeof(State));
  if (!*state) return say(instance, fmi3Error, "no memory is left for the state");
  memcpy(*state, &((Instance*)instance)->state, sizeof(State));
  return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
  memcpy(&((Instance*)instance)->state, state, sizeof(State));
  return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState* state) {
  free(*state);
  *state = NULL;
  return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t* size) {
  *size = sizeof(State);
  return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  if (size != sizeof(State)) return say(instance, fmi3Error, "a state has %zu bytes, not %zu", sizeof(State), size);
  memcpy(bytes, state, size);
  return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState* state) {
  if (size != sizeof(State)) return say(instance, fmi3Error, "a state has %zu bytes, not %zu", sizeof(State), size);
  if (!*state) *state = malloc(size);
  if (!*state) return say(instance, fmi3Error, "no memory is left for the state");
  memcpy(*state, bytes, size);
  return fmi3OK;
}

/* What the interface names, and this FMU does not have: */
