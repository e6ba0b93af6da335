"""From a scene to the text of its module: the build-time half of kaneflex, and the only importer of SymPy.

Import its modules, not names of the package: the printer of C needs no SymPy.

The pipeline, one file a stage:

    mechanism   scene.structure -> SymbolicMechanism: the runtime's Mechanism with symbols for numbers
    constraints what joints and drives demand, as residuals with multipliers
    rigid       Mechanism -> Kane's equations of the free bodies and the constraints between them
    closure     the positions of all bodies from the drives, in closed form
    motion      -> Motion: velocities, accelerations, reactions as assignments
    beam        Kane's equations of one differential particle -> the affine terms of an elastic element
    elements    the element's kernels, printed once for each theory: element_texts() -> text of the modules
    program     Program: scalar assignments; sharing, pruning, operation counts
    printers    Program -> numba function; numba function -> C; programs as LaTeX
    module_text tables, imports and the frame of a module around its kernels
    lookups_numba   what kernels call beside math
    packs       what kernels read and store in one statement
    bracketed   entries over several lines
    rows        rows of modules' tables, each kind said once: rows_text() -> module text
    c_module    kernels of a generated module as C11: generate_c(module, name) -> texts of files
    generate    the whole: generate(scene) -> module text; generate_pruned: without some groups of terms
    joints      what joints and springs do between two sections of bodies, printed once: joints_text() -> module text
    contact     what two sections do to each other where they touch: contact_text() -> module text
    friction    what resists sliding: friction_text() -> module text
    space       Kane's equations of a free body in space, and what joints and springs do there: spatial_text()
    body_equations  a body in the plane: its equations in space, restricted
    body_kinds  kinds of shapes and the sums over the mass that each requires; body_loops prints loops over them
    body_space  bodies in space that deform, printed by kinds of shapes: spatial_shapes_text()
    body_shortening  inertia that foreshortening adds to twist, for beams in space
    body_plane  the same kernels in the plane, and those of a point: body_text()
    laws_module     drives and loads, for the engine of all structures: generate_laws(scene) -> text
"""

if __name__ == "derive":
    raise ImportError("import kaneflex.derive, not derive: under two names it would be loaded twice")
