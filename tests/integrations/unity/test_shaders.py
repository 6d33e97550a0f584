"""The package's shaders: their HLSL compiled by glslang, with stand-ins for the pipelines, and the file's structure."""

import re
import shutil
import subprocess

import pytest

from .conftest import HERE, PACKAGE

FOLDER = PACKAGE / "Runtime" / "Resources"
SHADER = (FOLDER / "PuppetlineControls.shader").read_text()
ENTRIES = {"PuppetlineVertex": "vert", "PuppetlineFragment": "frag", "Frag": "frag"}


@pytest.fixture
def compile_hlsl(tmp_path):
    """Compile HLSL to SPIR-V, with stand-ins for the pipelines' files."""
    compiler = shutil.which("glslangValidator")
    if compiler is None:
        pytest.skip("glslangValidator is not here to compile HLSL with (Debian: glslang-tools)")
    stand_ins = HERE / "stand_ins" / "pipelines"
    for path in re.findall(r'#include "(Packages/[^"]+)"', "".join(f.read_text() for f in FOLDER.glob("*.hlsl"))):
        name = "HighDefinition" if "high-definition" in path else "Universal" if "universal" in path else "Shared"
        name = (
            "HighDefinitionPass"
            if "/ShaderPass/ShaderPass" in path and path.endswith(("Forward.hlsl", "DepthOnly.hlsl", "Vectors.hlsl"))
            else name
        )
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f'#include "{name}.hlsl"\n')

    def run(text, entry, *defines):
        source = tmp_path / "shader.hlsl"
        source.write_text(text)
        stage = ENTRIES.get(entry, "vert")
        includes = [f"-I{folder}" for folder in (tmp_path, stand_ins, FOLDER)]
        options = ["--auto-map-bindings", "--auto-map-locations", "-o", tmp_path / "out.spv"]
        command = [compiler, "-D", "-V", "-S", stage, "-e", entry, *includes, *(f"-D{each}=1" for each in defines)]
        compiled = subprocess.run([*command, *options, source], capture_output=True, text=True, check=False)
        assert compiled.returncode == 0, compiled.stdout
        assert "WARNING" not in compiled.stdout, compiled.stdout
        validator = shutil.which("spirv-val")
        if validator is not None:
            subprocess.run([validator, "--target-env", "vulkan1.1", tmp_path / "out.spv"], check=True)

    return run


UNIVERSAL = '#define PUPPETLINE_PASS PUPPETLINE_{}\n#include "PuppetlineUniversal.hlsl"\n'
HIGH_DEFINITION = '#define SHADERPASS SHADERPASS_{}\n#include "PuppetlineHighDefinition.hlsl"\n'
GRAPH = (
    '#include "PuppetlineGraph.hlsl"\n'
    "float4 main(float3 x : POSITION, float4 t : TEXCOORD1) : SV_Position\n"
    "{ float3 a; float3 b; PuppetlineBlend_float(x, x, t, t, t, a, b); return float4(a + b, 1); }\n"
)
BUILT_IN = (
    "#define UNITY_VERTEX_INPUT_INSTANCE_ID\n"
    "struct SurfaceOutputStandard { float3 Albedo, Emission; float Alpha, Metallic, Smoothness; };\n"
    "Texture2D textures; SamplerState filter;\n#define sampler2D Texture2D\n"
    "float4 tex2D(Texture2D from, float2 uv) { return from.Sample(filter, uv); }\n"
    '#include "PuppetlineBuiltIn.hlsl"\n'
    "float4 main(appdata v) : SV_Position { PuppetlineVertex(v); return v.vertex + float4(v.normal, 0); }\n"
)
MORE = ("_ALPHATEST_ON", "_CASTING_PUNCTUAL_LIGHT_SHADOW", "_MAIN_LIGHT_SHADOWS_SCREEN")
VULKAN, OPENGL = (f"SHADER_API_{name}" for name in ("VULKAN", "GLES3"))
SOURCES = [
    *(
        (UNIVERSAL.format(kind), f"Puppetline{entry}", api, *more)
        for kind in ("FORWARD", "SHADOW", "DEPTH", "DEPTH_NORMALS", "MOTION")
        for entry in ("Vertex", "Fragment")
        for api in (VULKAN, OPENGL)
        for more in ((), MORE)
    ),
    *(
        (HIGH_DEFINITION.format(kind), entry, VULKAN, "_ALPHATEST_ON")
        for kind in ("SHADOWS", "DEPTH_ONLY", "MOTION_VECTORS", "FORWARD")
        for entry in ("PuppetlineVertex", "Frag")
    ),
    *((GRAPH, "main", api) for api in (VULKAN, OPENGL)),
    *((BUILT_IN, "main", api) for api in (VULKAN, OPENGL, "SHADER_TARGET_SURFACE_ANALYSIS")),
]
"""Passes of URP, of HDRP, a function for Shader Graph and the surface shader of the built-in pipeline: source, entry
and definitions."""


def test_every_pass_compiles(compile_hlsl):
    for source in SOURCES:
        compile_hlsl(*source)


def test_each_pipeline_has_its_passes():
    """And those of URP and HDRP are only compiled where the package is installed."""
    sub_shaders = re.split(r"\n    SubShader\n", SHADER)[1:]
    passes = [re.findall(r'"LightMode" = "(\w+)"', each) for each in sub_shaders]
    urp = ["UniversalForwardOnly", "ShadowCaster", "DepthOnly", "DepthNormalsOnly"]
    hdrp = ["ShadowCaster", "DepthForwardOnly", "MotionVectors", "ForwardOnly"]
    assert passes == [[*urp, "MotionVectors"], urp, hdrp, [], []]
    required = [re.findall(r'PackageRequirements \{ "([\w.-]+)"', each) for each in sub_shaders]
    names = ["com.unity.render-pipelines.universal"] * 2 + ["com.unity.render-pipelines.high-definition"]
    assert required == [*([name] for name in names), [], []]
    programs = re.findall(r"(?:HLSL|CG)PROGRAM(.*?)END(?:HLSL|CG)", SHADER, re.DOTALL)
    assert len(programs) == 15
    renderers = [re.search(r"#pragma (exclude|only)_renderers (.*)", each).groups() for each in programs]
    targets = [re.search(r"#pragma target (.*)", each)[1] for each in programs]
    assert set(zip(targets, renderers, strict=True)) == {
        ("4.5", ("exclude", "gles gles3 glcore")),
        ("3.5", ("only", "gles3 glcore")),
    }
    assert SHADER.count("{") == SHADER.count("}")


def test_every_value_of_a_material_is_in_the_one_buffer_that_the_srp_batcher_wants():
    properties = dict(re.findall(r'^        (?:\[.*?\] )*(_\w+) \("[^"]*", (\w+)', SHADER, re.MULTILINE))
    surface = (FOLDER / "PuppetlineSurface.hlsl").read_text()
    buffer = surface.split("CBUFFER_START(UnityPerMaterial)")[1].split("CBUFFER_END")[0]
    in_buffer = set(re.findall(r"^float4? (_\w+);$", buffer, re.MULTILINE)) - {"_BaseMap_ST"}
    assert in_buffer <= set(properties)
    of_states = {"_AlphaClip", "_SrcBlend", "_DstBlend", "_ZWrite", "_Cull", "_Puppetline", "_BaseMap", "_EmissionMap"}
    assert set(properties) - in_buffer == of_states
