"""The package's shaders: their HLSL compiled by glslang, with stand-ins for the pipelines, and the file's structure."""

import re
import shutil
import subprocess

import pytest

from .conftest import HERE, PACKAGE

FOLDER = PACKAGE / "Runtime" / "Resources"
SHADER = (FOLDER / "PuppetlineControls.shader").read_text()
APIS = {"buffer": "SHADER_API_VULKAN", "texture": "SHADER_API_GLES3"}
UNIVERSAL = ("FORWARD", "SHADOW", "DEPTH", "DEPTH_NORMALS", "MOTION")
HIGH_DEFINITION = ("SHADOWS", "DEPTH_ONLY", "MOTION_VECTORS", "FORWARD")
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


@pytest.mark.parametrize("api", APIS)
@pytest.mark.parametrize("entry", ["PuppetlineVertex", "PuppetlineFragment"])
@pytest.mark.parametrize("kind", UNIVERSAL)
def test_every_pass_of_urp_compiles(compile_hlsl, kind, entry, api):
    text = f'#define PUPPETLINE_PASS PUPPETLINE_{kind}\n#include "PuppetlineUniversal.hlsl"\n'
    compile_hlsl(text, entry, APIS[api])
    compile_hlsl(
        text, entry, APIS[api], "_ALPHATEST_ON", "_CASTING_PUNCTUAL_LIGHT_SHADOW", "_MAIN_LIGHT_SHADOWS_SCREEN"
    )


@pytest.mark.parametrize("entry", ["PuppetlineVertex", "Frag"])
@pytest.mark.parametrize("kind", HIGH_DEFINITION)
def test_every_pass_of_hdrp_compiles(compile_hlsl, kind, entry):
    text = f'#define SHADERPASS SHADERPASS_{kind}\n#include "PuppetlineHighDefinition.hlsl"\n'
    compile_hlsl(text, entry, "SHADER_API_VULKAN", "_ALPHATEST_ON")


@pytest.mark.parametrize("api", APIS)
def test_the_function_for_shader_graph_compiles(compile_hlsl, api):
    text = (
        '#include "PuppetlineGraph.hlsl"\n'
        "float4 main(float3 x : POSITION, float4 t : TEXCOORD1) : SV_Position\n"
        "{ float3 a; float3 b; PuppetlineBlend_float(x, x, t, t, t, a, b); return float4(a + b, 1); }\n"
    )
    compile_hlsl(text, "main", APIS[api])


@pytest.mark.parametrize(
    "defines", [("SHADER_API_VULKAN",), ("SHADER_API_GLES3",), ("SHADER_TARGET_SURFACE_ANALYSIS",)]
)
def test_the_built_in_pipelines_surface_shader_compiles(compile_hlsl, defines):
    text = (
        "#define UNITY_VERTEX_INPUT_INSTANCE_ID\n"
        "struct SurfaceOutputStandard { float3 Albedo, Emission; float Alpha, Metallic, Smoothness; };\n"
        "Texture2D textures; SamplerState filter;\n#define sampler2D Texture2D\n"
        "float4 tex2D(Texture2D from, float2 uv) { return from.Sample(filter, uv); }\n"
        '#include "PuppetlineBuiltIn.hlsl"\n'
        "float4 main(appdata v) : SV_Position { PuppetlineVertex(v); return v.vertex + float4(v.normal, 0); }\n"
    )
    compile_hlsl(text, "main", *defines)


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
