"""STEP files of prisms, as a CAD system writes them (AP214, ISO 10303-21)."""

import numpy as np

UNITS = {
    "m": "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))",
    "mm": "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))",
    "inch": "(CONVERSION_BASED_UNIT('INCH',#{measure})LENGTH_UNIT()NAMED_UNIT(#{exponents}))",
}
HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""


class Step:
    """Lines of a STEP file, numbered."""

    def __init__(self):
        self.lines = []

    def add(self, text) -> str:
        self.lines.append(text)
        return f"#{len(self.lines)}"

    def point(self, x):
        return self.add("CARTESIAN_POINT('',({:.9g},{:.9g},{:.9g}))".format(*(float(v) for v in x)))

    def direction(self, x):
        return self.add("DIRECTION('',({:.12g},{:.12g},{:.12g}))".format(*(float(v) for v in x)))

    def listed(self, kind, members) -> str:
        return self.add(f"{kind}('',({','.join(members)}))")

    def solid(self, name, corners, faces) -> str:
        """A body of plane faces (k corners each, counter-clockwise from outside)."""
        places = [self.point(x) for x in corners]
        vertices = [self.add(f"VERTEX_POINT('',{place})") for place in places]
        edges, shells = {}, []
        for face in faces:
            loop = []
            for a, b in zip(face, np.roll(face, -1), strict=True):
                pair = min(a, b), max(a, b)
                if pair not in edges:
                    along = corners[pair[1]] - corners[pair[0]]
                    size = np.linalg.norm(along)
                    vector = self.add(f"VECTOR('',{self.direction(along / size)},1.)")
                    line = self.add(f"LINE('',{places[pair[0]]},{vector})")
                    edges[pair] = self.add(f"EDGE_CURVE('',{vertices[pair[0]]},{vertices[pair[1]]},{line},.T.)")
                loop.append(self.add(f"ORIENTED_EDGE('',*,*,{edges[pair]},{'.T.' if a < b else '.F.'})"))
            bound = self.add(f"FACE_OUTER_BOUND('',{self.listed('EDGE_LOOP', loop)},.T.)")
            normal = 0.5 * sum(np.cross(corners[a], corners[b]) for a, b in zip(face, np.roll(face, -1), strict=True))
            first = corners[face[1]] - corners[face[0]]
            normal, first = (self.direction(v / np.linalg.norm(v)) for v in (normal, first))
            plane = self.add(f"AXIS2_PLACEMENT_3D('',{places[face[0]]},{normal},{first})")
            plane = self.add(f"PLANE('',{plane})")
            shells.append(self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
        return self.add(f"MANIFOLD_SOLID_BREP('{name}',{self.listed('CLOSED_SHELL', shells)})")


def cylinder(step, name, radius, height) -> str:
    """A round body on the axis z: two plane faces and one that is closed along a seam."""
    low, high = (step.point((0, 0, z)) for z in (0, height))
    up, down, along = (step.direction(v) for v in ((0, 0, 1), (0, 0, -1), (1, 0, 0)))
    ends, rings, frames = [], [], []
    for z, place in ((0, low), (height, high)):
        ends.append(step.add(f"VERTEX_POINT('',{step.point((radius, 0, z))})"))
        frames.append(step.add(f"AXIS2_PLACEMENT_3D('',{place},{up},{along})"))
        circle = step.add(f"CIRCLE('',{frames[-1]},{radius:.9g})")
        rings.append(step.add(f"EDGE_CURVE('',{ends[-1]},{ends[-1]},{circle},.T.)"))
    line = step.add(f"VECTOR('',{up},1.)")
    line = step.add(f"LINE('',{step.point((radius, 0, 0))},{line})")
    seam = step.add(f"EDGE_CURVE('',{ends[0]},{ends[1]},{line},.T.)")
    round_face = step.add(f"CYLINDRICAL_SURFACE('',{frames[0]},{radius:.9g})")
    under = step.add(f"AXIS2_PLACEMENT_3D('',{low},{down},{along})")
    faces = [(round_face, [(rings[0], "T"), (seam, "T"), (rings[1], "F"), (seam, "F")])]
    faces += [
        (step.add(f"PLANE('',{under})"), [(rings[0], "F")]),
        (step.add(f"PLANE('',{frames[1]})"), [(rings[1], "T")]),
    ]
    shell = []
    for surface, edges in faces:
        loop = step.listed("EDGE_LOOP", [step.add(f"ORIENTED_EDGE('',*,*,{edge},.{way}.)") for edge, way in edges])
        bound = step.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        shell.append(step.add(f"ADVANCED_FACE('',({bound}),{surface},.T.)"))
    return step.add(f"MANIFOLD_SOLID_BREP('{name}',{step.listed('CLOSED_SHELL', shell)})")


def prism(outline, thickness, at=0.0):
    """Corners and faces of a prism: an outline (k, 2) in x and z, counter-clockwise, from y = ``at`` on."""
    outline = np.array(outline, float)
    n = len(outline)
    corners = np.array([(x, y, z) for y in (at, at + thickness) for x, z in outline])
    sides = [(k, n + k, n + (k + 1) % n, (k + 1) % n) for k in range(n)]
    return corners, [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1)), *sides]


def write_step(path, bodies, unit="mm"):
    """A STEP file of named bodies, {name: (corners, faces)} or {name: (radius, height)} of a round one, each a part of
    its own, with lengths in a unit."""
    step = Step()
    exponents = step.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")[1:]
    metre = step.add(UNITS["m"])
    measure = step.add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.0254),{metre})")[1:]
    length = step.add(UNITS[unit].format(measure=measure, exponents=exponents))
    angle = step.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    solid = step.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    near = step.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-7),{length},'distance','')")
    context = step.add(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({near}))"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid}))REPRESENTATION_CONTEXT('',''))"
    )
    application = step.add("APPLICATION_CONTEXT('automotive design')")
    step.add(f"APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,{application})")
    for name, (first, second) in bodies.items():
        origin, up, along = step.point((0, 0, 0)), step.direction((0, 0, 1)), step.direction((1, 0, 0))
        axes = step.add(f"AXIS2_PLACEMENT_3D('',{origin},{up},{along})")
        plane = isinstance(second, list)
        brep = step.solid(name, np.array(first, float), second) if plane else cylinder(step, name, first, second)
        shape = step.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({axes},{brep}),{context})")
        product = step.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
        product = step.add(f"PRODUCT('{name}','{name}','',({product}))")
        product = step.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        design = step.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
        shown = step.add(f"PRODUCT_DEFINITION('design','',{product},{design})")
        shown = step.add(f"PRODUCT_DEFINITION_SHAPE('','',{shown})")
        step.add(f"SHAPE_DEFINITION_REPRESENTATION({shown},{shape})")
    lines = "".join(f"#{k}={line};\n" for k, line in enumerate(step.lines, 1))
    path.write_text(HEAD + lines + "ENDSEC;\nEND-ISO-10303-21;\n")
    return path
