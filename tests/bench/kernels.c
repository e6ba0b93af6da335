/* The measure of the generated kernels: what a C programmer would write by hand from the closed forms of the beam
 * element and of the slider-crank. Same arguments, same outputs as the kernels of generated/slider_crank_150.py:
 * structural zeros are not stored. Below each kernel's name stands a loop that is timed, NAME_many. The places of the
 * motion's numbers are the module's own: places.h is written from its PARAMETERS and SCALARS, by name. */

#include <math.h>

#include "places.h"

enum { RHO_A, E_A, E_I, LENGTH, X_0 };
enum { OMEGA, EPSILON, A_X, A_Y, P_0 };

/* Consistent mass matrix, Przemieniecki (1968), on top of whatever factor stands before it. */
static inline void consistent(double rho_A_l, double l, double (*m)[6])
{
    const double f = rho_A_l / 420.0, fl = f * l, fll = fl * l;
    m[0][0] = m[3][3] = 140.0 * f;
    m[0][3] = m[3][0] = 70.0 * f;
    m[1][1] = m[4][4] = 156.0 * f;
    m[1][4] = m[4][1] = 54.0 * f;
    m[1][2] = m[2][1] = 22.0 * fl;
    m[4][5] = m[5][4] = -22.0 * fl;
    m[2][4] = m[4][2] = 13.0 * fl;
    m[1][5] = m[5][1] = -13.0 * fl;
    m[2][2] = m[5][5] = 4.0 * fll;
    m[2][5] = m[5][2] = -3.0 * fll;
}

/* factor * G with G = int rho A N^T S N dx, skew. */
static inline void gyration(double factor, double l, double (*g)[6])
{
    const double f = factor / 60.0, fl = f * l;
    g[1][0] = g[4][3] = 21.0 * f;
    g[0][1] = g[3][4] = -21.0 * f;
    g[1][3] = g[4][0] = 9.0 * f;
    g[3][1] = g[0][4] = -9.0 * f;
    g[2][0] = g[3][5] = 3.0 * fl;
    g[0][2] = g[5][3] = -3.0 * fl;
    g[0][5] = g[2][3] = 2.0 * fl;
    g[5][0] = g[3][2] = -2.0 * fl;
}

static inline void M(const double *p, double (*out)[6])
{
    consistent(p[RHO_A] * p[LENGTH], p[LENGTH], out);
}

static inline void K_s(const double *p, double (*out)[6])
{
    const double l = p[LENGTH], a = p[E_A] / l, b = p[E_I] / (l * l * l), bl = b * l, bll = bl * l;
    out[0][0] = out[3][3] = a;
    out[0][3] = out[3][0] = -a;
    out[1][1] = out[4][4] = 12.0 * b;
    out[1][4] = out[4][1] = -12.0 * b;
    out[1][2] = out[2][1] = out[1][5] = out[5][1] = 6.0 * bl;
    out[2][4] = out[4][2] = out[4][5] = out[5][4] = -6.0 * bl;
    out[2][2] = out[5][5] = 4.0 * bll;
    out[2][5] = out[5][2] = 2.0 * bll;
}

/* K_d = -omega^2 M + epsilon G: the two share no entry. */
static inline void K_d(const double *p, const double *s, double (*out)[6])
{
    const double l = p[LENGTH], m = p[RHO_A] * l, w = s[OMEGA], e = s[EPSILON];
    consistent(-w * w * m, l, out);
    gyration(e * m, l, out);
}

/* Tension c0 + c1 s + c2 s^2 along the element, and Przemieniecki's (1968) matrices of its powers. */
static inline void K_g(const double *p, const double *s, double (*out)[6])
{
    const double l = p[LENGTH], x = p[X_0];
    const double P_1 = p[RHO_A] * s[A_X], P_2 = -0.5 * p[RHO_A] * s[OMEGA] * s[OMEGA];
    const double c0 = s[P_0] + (P_1 + P_2 * x) * x, c1 = (P_1 + 2.0 * P_2 * x) * l, c2 = P_2 * l * l;
    const double vv = ((36.0 / 30.0) * c0 + (36.0 / 60.0) * c1 + (72.0 / 210.0) * c2) / l;
    const double v1 = (3.0 / 30.0) * c0 + (6.0 / 60.0) * c1 + (15.0 / 210.0) * c2;
    const double v2 = (3.0 / 30.0) * c0 - (6.0 / 210.0) * c2;
    const double near = l * ((4.0 / 30.0) * c0 + (2.0 / 60.0) * c1 + (4.0 / 210.0) * c2);
    const double far = l * ((4.0 / 30.0) * c0 + (6.0 / 60.0) * c1 + (18.0 / 210.0) * c2);
    const double across = -l * ((1.0 / 30.0) * c0 + (1.0 / 60.0) * c1 + (3.0 / 210.0) * c2);
    out[1][1] = out[4][4] = vv;
    out[1][4] = out[4][1] = -vv;
    out[1][2] = out[2][1] = v1;
    out[2][4] = out[4][2] = -v1;
    out[1][5] = out[5][1] = v2;
    out[4][5] = out[5][4] = -v2;
    out[2][2] = near;
    out[5][5] = far;
    out[2][5] = out[5][2] = across;
}

static inline void C(const double *p, const double *s, double (*out)[6])
{
    gyration(2.0 * s[OMEGA] * p[RHO_A] * p[LENGTH], p[LENGTH], out);
}

static inline void F(const double *p, const double *s, double *out)
{
    const double l = p[LENGTH], x = p[X_0], m = p[RHO_A] * l, ml = m * l;
    const double along = -0.5 * m * s[A_X], across = -0.5 * m * s[A_Y], turning = across * l / 6.0;
    const double w2 = s[OMEGA] * s[OMEGA], e = s[EPSILON], half = 0.5 * m * x, moment = half * l / 6.0;
    out[0] = along + w2 * (half + ml / 6.0);
    out[1] = across - e * (half + ml * (9.0 / 60.0));
    out[2] = turning - e * (moment + ml * l * (2.0 / 60.0));
    out[3] = along + w2 * (half + ml / 3.0);
    out[4] = across - e * (half + ml * (21.0 / 60.0));
    out[5] = -turning + e * (moment + ml * l * (3.0 / 60.0));
}

/* Slider-crank at constant speed: positions, velocities and accelerations by differentiating
 * L sin phi2 = -r sin phi by hand, forces by Newton and Euler from the slider to the shaft. */
static inline void motion(double t, const double *p, double *s)
{
    const double d = p[bodies_rod_centre_x], m = p[bodies_rod_mass], J = p[bodies_rod_inertia];
    const double slider = p[bodies_slider_mass], branch = p[joints_guide_branch];
    const double r = p[bodies_crank_length], L = p[bodies_rod_length], w = p[drives_main_speed];
    const double phi = p[drives_main_angle] + w * t, s1 = sin(phi), c1 = cos(phi);
    const double s2 = -r * s1 / L, margin = 1.0 - s2 * s2, c2 = branch * sqrt(margin);
    const double rs = r * s1, rc = r * c1, over = 1.0 / (L * c2);
    const double w2 = -w * rc * over;
    const double ax = -w * w * rc, ay = -w * w * rs;
    const double e2 = (L * w2 * w2 * s2 - ay) * over;
    const double slider_a = ax - L * (e2 * s2 + w2 * w2 * c2);
    const double rod_ax = ax - d * (e2 * s2 + w2 * w2 * c2), rod_ay = ay + d * (e2 * c2 - w2 * w2 * s2);
    const double B_x = slider * slider_a, A_x = m * rod_ax + B_x;
    const double B_y = (d * s2 * A_x + (L - d) * s2 * B_x - J * e2 - d * c2 * m * rod_ay) * over;
    const double A_y = m * rod_ay + B_y;
    s[rod_link_omega] = s[rod_omega] = w2;
    s[rod_link_epsilon] = s[rod_epsilon] = e2;
    s[rod_link_a_x] = ax * c2 + ay * s2;
    s[rod_link_a_y] = ay * c2 - ax * s2;
    s[rod_link_P_0] = -(A_x * c2 + A_y * s2);
    s[main_angle] = phi;
    s[crank_c] = c1;
    s[crank_s] = s1;
    s[crank_omega] = w;
    s[rod_x] = rc;
    s[rod_y] = rs;
    s[rod_c] = c2;
    s[rod_s] = s2;
    s[rod_v_x] = -w * rs;
    s[rod_v_y] = w * rc;
    s[rod_a_x] = ax;
    s[rod_a_y] = ay;
    s[slider_x] = rc + L * c2;
    s[slider_y] = 0.0;
    s[slider_v_x] = -w * rs - L * w2 * s2;
    s[slider_a_x] = slider_a;
    s[guide_normal] = -B_y;
    s[main_force_x] = s[pin_force_x] = A_x;
    s[main_force_y] = s[pin_force_y] = A_y;
    s[wrist_force_x] = B_x;
    s[wrist_force_y] = B_y;
    s[main_drive] = rc * A_y - rs * A_x;
    s[guide_closure] = margin;
}

/* Each evaluation has inputs of its own, out of 16; nothing is declared free of aliases, so none is left out. */
#define EACH(CALL)                                             \
    for (long i = 0; i < n; i++) {                             \
        p[LENGTH] = varied[i & 15];                            \
        s[OMEGA] = varied[i & 15];                             \
        CALL;                                                  \
    }
#define ARGUMENTS long n, const double *varied, double *p, double *s

void M_many(ARGUMENTS, double (*out)[6]) { EACH(M(p, out)) }
void K_s_many(ARGUMENTS, double (*out)[6]) { EACH(K_s(p, out)) }
void K_d_many(ARGUMENTS, double (*out)[6]) { EACH(K_d(p, s, out)) }
void K_g_many(ARGUMENTS, double (*out)[6]) { EACH(K_g(p, s, out)) }
void C_many(ARGUMENTS, double (*out)[6]) { EACH(C(p, s, out)) }
void F_many(ARGUMENTS, double *out) { EACH(F(p, s, out)) }

void element_many(ARGUMENTS, double (*m)[6], double (*k_s)[6], double (*k_d)[6], double (*k_g)[6], double (*c)[6],
                  double *f)
{
    EACH(M(p, m); K_s(p, k_s); K_d(p, s, k_d); K_g(p, s, k_g); C(p, s, c); F(p, s, f))
}

void motion_many(long n, const double *varied, const double *p, double *s)
{
    for (long i = 0; i < n; i++)
        motion(varied[i & 15], p, s);
}
