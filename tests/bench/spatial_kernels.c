/* The measure of the kernels of an element in space, as kernels.c is that of the planar ones: the same closed forms,
 * Przemieniecki (1968), once a plane. Same arguments, same outputs as the kernels of
 * generated/spatial_beam_euler_bernoulli.py: structural zeros are not stored. */

enum { RHO_A, RHO_I_Y, RHO_I_Z, E_I_Y, E_I_Z, E_A, G_J, I_P_A, LENGTH, X_0 };
enum { OMEGA_X, OMEGA_Y, OMEGA_Z, EPSILON_X, EPSILON_Y, EPSILON_Z, A_X, A_Y, A_Z, P_0 };

/* Rows of the first node, those of the second lie 6 behind. theta_y is -w': across z a length is negative. */
enum { U, V, W, THETA_X, THETA_Y, THETA_Z, SECOND };

/* Of u or theta_x, linear along the element: f int N^T N ds. */
static inline void linear(double f, int u, double (*m)[12])
{
    m[u][u] = m[u + SECOND][u + SECOND] = f / 3.0;
    m[u][u + SECOND] = m[u + SECOND][u] = f / 6.0;
}

/* Of v or w, f int N^T N ds. */
static inline void consistent(double factor, double l, int v, int t, double (*m)[12])
{
    const double f = factor / 420.0, fl = f * l, fll = fl * l;
    const int v2 = v + SECOND, t2 = t + SECOND;
    m[v][v] = m[v2][v2] = 156.0 * f;
    m[v][v2] = m[v2][v] = 54.0 * f;
    m[v][t] = m[t][v] = 22.0 * fl;
    m[v2][t2] = m[t2][v2] = -22.0 * fl;
    m[t][v2] = m[v2][t] = 13.0 * fl;
    m[v][t2] = m[t2][v] = -13.0 * fl;
    m[t][t] = m[t2][t2] = 4.0 * fll;
    m[t][t2] = m[t2][t] = -3.0 * fll;
}

/* f times int N_u^T N_v ds at rows of u, g times its transpose at its columns; of v or w. */
static inline void along_across(double f, double g, double l, int v, int t, double (*m)[12])
{
    const int u2 = U + SECOND, v2 = v + SECOND, t2 = t + SECOND;
    const double a = f / 60.0, al = a * l, b = g / 60.0, bl = b * l;
    m[U][v] = m[u2][v2] = 21.0 * a;
    m[U][v2] = m[u2][v] = 9.0 * a;
    m[U][t] = 3.0 * al;
    m[u2][t2] = -3.0 * al;
    m[u2][t] = 2.0 * al;
    m[U][t2] = -2.0 * al;
    m[v][U] = m[v2][u2] = 21.0 * b;
    m[v2][U] = m[v][u2] = 9.0 * b;
    m[t][U] = 3.0 * bl;
    m[t2][u2] = -3.0 * bl;
    m[t][u2] = 2.0 * bl;
    m[t2][U] = -2.0 * bl;
}

/* factor times int N_v^T N_w ds at these rows and columns, one's rotations by l and the other's by -l. */
static inline void across_rows(double factor, double l, int v, int tv, int w, int tw, double (*m)[12])
{
    const int v2 = v + SECOND, tv2 = tv + SECOND, w2 = w + SECOND, tw2 = tw + SECOND;
    const double f = factor / 420.0, fl = f * l, fll = fl * l;
    m[v][w] = m[v2][w2] = 156.0 * f;
    m[v][w2] = m[v2][w] = 54.0 * f;
    m[v][tw] = m[tv2][w2] = -22.0 * fl;
    m[tv][w] = m[v2][tw2] = 22.0 * fl;
    m[v2][tw] = m[tv2][w] = -13.0 * fl;
    m[tv][w2] = m[v][tw2] = 13.0 * fl;
    m[tv][tw] = m[tv2][tw2] = -4.0 * fll;
    m[tv][tw2] = m[tv2][tw] = 3.0 * fll;
}

static inline void M(const double *p, double (*out)[12])
{
    const double l = p[LENGTH], m = p[RHO_A] * l;
    linear(m, U, out);
    consistent(m, l, V, THETA_Z, out);
    consistent(m, -l, W, THETA_Y, out);
    linear((p[RHO_I_Y] + p[RHO_I_Z]) * l, THETA_X, out);
}

static inline void spring(double k, int u, double (*m)[12])
{
    m[u][u] = m[u + SECOND][u + SECOND] = k;
    m[u][u + SECOND] = m[u + SECOND][u] = -k;
}

static inline void bending(double E_I, double l, double over, int v, int t, double (*m)[12])
{
    const int v2 = v + SECOND, t2 = t + SECOND;
    const double b = E_I * over * over * over, bl = b * l, bll = bl * l;
    m[v][v] = m[v2][v2] = 12.0 * b;
    m[v][v2] = m[v2][v] = -12.0 * b;
    m[v][t] = m[t][v] = m[v][t2] = m[t2][v] = 6.0 * bl;
    m[t][v2] = m[v2][t] = m[v2][t2] = m[t2][v2] = -6.0 * bl;
    m[t][t] = m[t2][t2] = 4.0 * bll;
    m[t][t2] = m[t2][t] = 2.0 * bll;
}

static inline void K_s(const double *p, double (*out)[12])
{
    const double l = p[LENGTH], over = 1.0 / l;
    spring(p[E_A] * over, U, out);
    bending(p[E_I_Z], l, over, V, THETA_Z, out);
    bending(p[E_I_Y], -l, over, W, THETA_Y, out);
    spring(p[G_J] * over, THETA_X, out);
}

static inline void K_d(const double *p, const double *s, double (*out)[12])
{
    const double l = p[LENGTH], m = p[RHO_A] * l;
    const double xx = s[OMEGA_X] * s[OMEGA_X], yy = s[OMEGA_Y] * s[OMEGA_Y], zz = s[OMEGA_Z] * s[OMEGA_Z];
    const double xy = s[OMEGA_X] * s[OMEGA_Y], xz = s[OMEGA_X] * s[OMEGA_Z], yz = s[OMEGA_Y] * s[OMEGA_Z];
    linear(-m * (yy + zz), U, out);
    along_across(m * (xy - s[EPSILON_Z]), m * (xy + s[EPSILON_Z]), l, V, THETA_Z, out);
    along_across(m * (xz + s[EPSILON_Y]), m * (xz - s[EPSILON_Y]), -l, W, THETA_Y, out);
    consistent(-m * (xx + zz), l, V, THETA_Z, out);
    across_rows(m * (yz - s[EPSILON_X]), l, V, THETA_Z, W, THETA_Y, out);
    across_rows(m * (yz + s[EPSILON_X]), -l, W, THETA_Y, V, THETA_Z, out);
    consistent(-m * (xx + yy), -l, W, THETA_Y, out);
    linear((p[RHO_I_Z] - p[RHO_I_Y]) * l * (zz - yy), THETA_X, out);
}

/* A tension along the element, (c[0] + c[1] s + c[2] s^2) l, on what bends in one plane. */
static inline void taut(const double *c, double l, int v, int t, double (*m)[12])
{
    const int v2 = v + SECOND, t2 = t + SECOND;
    const double vv = (36.0 / 30.0) * c[0] + (36.0 / 60.0) * c[1] + (72.0 / 210.0) * c[2];
    const double v_1 = l * ((3.0 / 30.0) * c[0] + (6.0 / 60.0) * c[1] + (15.0 / 210.0) * c[2]);
    const double v_2 = l * ((3.0 / 30.0) * c[0] - (6.0 / 210.0) * c[2]);
    const double ll = l * l;
    m[v][v] = m[v2][v2] = vv;
    m[v][v2] = m[v2][v] = -vv;
    m[v][t] = m[t][v] = v_1;
    m[t][v2] = m[v2][t] = -v_1;
    m[v][t2] = m[t2][v] = v_2;
    m[v2][t2] = m[t2][v2] = -v_2;
    m[t][t] = ll * ((4.0 / 30.0) * c[0] + (2.0 / 60.0) * c[1] + (4.0 / 210.0) * c[2]);
    m[t2][t2] = ll * ((4.0 / 30.0) * c[0] + (6.0 / 60.0) * c[1] + (18.0 / 210.0) * c[2]);
    m[t][t2] = m[t2][t] = -ll * ((1.0 / 30.0) * c[0] + (1.0 / 60.0) * c[1] + (3.0 / 210.0) * c[2]);
}

static inline void K_g(const double *p, const double *s, double (*out)[12])
{
    const double l = p[LENGTH], x = p[X_0];
    const double P_1 = p[RHO_A] * s[A_X];
    const double P_2 = -0.5 * p[RHO_A] * (s[OMEGA_Y] * s[OMEGA_Y] + s[OMEGA_Z] * s[OMEGA_Z]);
    const double c[] = {(s[P_0] + (P_1 + P_2 * x) * x) / l, P_1 + 2.0 * P_2 * x, P_2 * l};
    taut(c, l, V, THETA_Z, out);
    taut(c, -l, W, THETA_Y, out);
    spring(p[I_P_A] * (c[0] + c[1] / 2.0 + c[2] / 3.0), THETA_X, out);
}

static inline void C(const double *p, const double *s, double (*out)[12])
{
    const double l = p[LENGTH], m = 2.0 * p[RHO_A] * l;
    along_across(-m * s[OMEGA_Z], m * s[OMEGA_Z], l, V, THETA_Z, out);
    along_across(m * s[OMEGA_Y], -m * s[OMEGA_Y], -l, W, THETA_Y, out);
    across_rows(-m * s[OMEGA_X], l, V, THETA_Z, W, THETA_Y, out);
    across_rows(m * s[OMEGA_X], -l, W, THETA_Y, V, THETA_Z, out);
}

/* A force per length that grows from f0 by f1, both times l, on what bends in one plane. */
static inline void spread(double f0, double f1, double l, int v, int t, double *out)
{
    out[v] = 0.5 * f0 + (9.0 / 60.0) * f1;
    out[t] = l * (f0 / 12.0 + (2.0 / 60.0) * f1);
    out[v + SECOND] = 0.5 * f0 + (21.0 / 60.0) * f1;
    out[t + SECOND] = -l * (f0 / 12.0 + (3.0 / 60.0) * f1);
}

static inline void F(const double *p, const double *s, double *out)
{
    const double l = p[LENGTH], x = p[X_0], m = p[RHO_A] * l, ml = m * l;
    const double across = s[OMEGA_Y] * s[OMEGA_Y] + s[OMEGA_Z] * s[OMEGA_Z];
    const double turn_v = s[OMEGA_X] * s[OMEGA_Y] + s[EPSILON_Z], turn_w = s[OMEGA_X] * s[OMEGA_Z] - s[EPSILON_Y];
    const double along = 0.5 * m * (across * x - s[A_X]), grown = ml * across;
    out[U] = along + grown / 6.0;
    out[U + SECOND] = along + grown / 3.0;
    spread(-m * (s[A_Y] + turn_v * x), -ml * turn_v, l, V, THETA_Z, out);
    spread(-m * (s[A_Z] + turn_w * x), -ml * turn_w, -l, W, THETA_Y, out);
    out[THETA_X] = out[THETA_X + SECOND] =
        0.5 * l * ((p[RHO_I_Y] - p[RHO_I_Z]) * s[OMEGA_Y] * s[OMEGA_Z] - (p[RHO_I_Y] + p[RHO_I_Z]) * s[EPSILON_X]);
}

/* Each evaluation has inputs of its own, out of 16; nothing is declared free of aliases, so none is left out. */
#define EACH(CALL)                                                      \
    for (long i = 0; i < n; i++) {                                      \
        const double *p = parameters[i & 15], *s = scalars[i & 15];     \
        CALL;                                                           \
    }
#define ARGUMENTS long n, double (*parameters)[10], double (*scalars)[10]

void M_many(ARGUMENTS, double (*out)[12]) { EACH(M(p, out)) }
void K_s_many(ARGUMENTS, double (*out)[12]) { EACH(K_s(p, out)) }
void K_d_many(ARGUMENTS, double (*out)[12]) { EACH(K_d(p, s, out)) }
void K_g_many(ARGUMENTS, double (*out)[12]) { EACH(K_g(p, s, out)) }
void C_many(ARGUMENTS, double (*out)[12]) { EACH(C(p, s, out)) }
void F_many(ARGUMENTS, double *out) { EACH(F(p, s, out)) }

void element_many(ARGUMENTS, double (*m)[12], double (*k_s)[12], double (*k_d)[12], double (*k_g)[12], double (*c)[12],
                  double *f)
{
    EACH(M(p, m); K_s(p, k_s); K_d(p, s, k_d); K_g(p, s, k_g); C(p, s, c); F(p, s, f))
}
