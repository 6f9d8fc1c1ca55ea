/* SPDX-License-Identifier: MIT */
/*
 * base_values.cpp - prints values of everything that robot/argos/base.hpp has, one line each. It
 * uses ARGoS's names only: base_values.txt is what it printed with ARGoS's own headers and sources
 * (github.com/ilpincy/argos3 at 421bd76, double precision, g++ 12.2, x86-64, as a shared
 * library).
 */
#include <argos3/core/utility/configuration/argos_configuration.h>
#include <argos3/core/utility/configuration/argos_exception.h>
#include <argos3/core/utility/datatypes/any.h>
#include <argos3/core/utility/datatypes/byte_array.h>
#include <argos3/core/utility/datatypes/color.h>
#include <argos3/core/utility/math/angles.h>
#include <argos3/core/utility/math/general.h>
#include <argos3/core/utility/math/quaternion.h>
#include <argos3/core/utility/math/range.h>
#include <argos3/core/utility/math/ray2.h>
#include <argos3/core/utility/math/ray3.h>
#include <argos3/core/utility/math/rng.h>
#include <argos3/core/utility/math/vector2.h>
#include <argos3/core/utility/math/vector3.h>
#include <argos3/core/utility/plugins/factory.h>
#include <argos3/core/utility/string_utilities.h>

#include <cstdio>

using namespace argos;

/* Constants of this file that are made of ARGoS's: they must be there already. */
static const CRadians EARLY = CRadians::PI_OVER_THREE * 2.0;
static const CRange<CRadians> EARLY_RANGE = CRadians::SIGNED_RANGE;
static const CColor EARLY_COLOR = CColor::ORANGE;
static const CVector3 EARLY_VECTOR = CVector3::Z;

static void Show(const char *name, double value)
{
    std::printf("%s %.15g\n", name, value == 0.0 ? 0.0 : value);
}

static void Show(const char *name, const std::string &value)
{
    std::printf("%s %s\n", name, value.c_str());
}

static void Show(const char *name, const CVector2 &v)
{
    Show(name, v.GetX());
    Show(name, v.GetY());
}

static void Show(const char *name, const CVector3 &v)
{
    Show(name, v.GetX());
    Show(name, v.GetY());
    Show(name, v.GetZ());
}

static void Show(const char *name, const CQuaternion &q)
{
    CRadians z, y, x, angle;
    CVector3 axis;
    q.ToEulerAngles(z, y, x);
    q.ToAngleAxis(angle, axis);
    Show(name, q.GetW());
    Show(name, CVector3(q.GetX(), q.GetY(), q.GetZ()));
    Show(name, CVector3(z.GetValue(), y.GetValue(), x.GetValue()));
    Show(name, angle.GetValue());
    Show(name, axis);
}

static void Numbers()
{
    const Real values[] = {-2.5, -2.0, -0.4, 0.0, 0.5, 1.0, 2.49};
    for (Real value : values) {
        Show("floor", Floor(value));
        Show("ceil", Ceil(value));
        Show("round", Round(value));
        Show("closest", RoundClosestToZero(value));
        Show("sign", Sign(value));
        Show("abs", Abs(value));
        Show("square", Square(value));
    }
    Show("min", Min<Real>(1.5, -3.0));
    Show("max", Max<SInt32>(4, 7));
    Show("equal", DoubleEq(1.0, 1.00009));
    Show("equal", DoubleEq(1000.0, 1000.2));
    std::vector<std::pair<Real, Real> > points;
    points.push_back(std::make_pair(0.0, 1.0));
    points.push_back(std::make_pair(1.0, 3.0));
    points.push_back(std::make_pair(3.0, -1.0));
    const Real places[] = {-1.0, 0.25, 1.0, 2.0, 5.0};
    for (Real x : places)
        Show("interpolate", Interpolate(x, points));
}

static void Angles()
{
    const Real values[] = {-10.0, -3.2, -1.0, 0.0, 2.0, 3.15, 6.5, 100.0};
    for (Real value : values) {
        CRadians angle(value);
        CDegrees degrees(value * 50.0);
        Show("signed", CRadians(angle).SignedNormalize().GetValue());
        Show("unsigned", CRadians(angle).UnsignedNormalize().GetValue());
        Show("signed_degrees", CDegrees(degrees).SignedNormalize().GetValue());
        Show("difference", NormalizedDifference(angle, CRadians::PI_OVER_SIX).GetValue());
        Show("difference_degrees", NormalizedDifference(degrees, CDegrees(30.0)).GetValue());
        Show("to_degrees", ToDegrees(angle).GetValue());
        Show("to_radians", ToRadians(degrees).GetValue());
        Show("sin", Sin(angle));
        Show("cos", Cos(angle));
        Show("atan2", ATan2(value, 0.7).GetValue());
        Show("ratio", angle / CRadians::PI);
        Show("words", ToString(angle) + ToString(degrees));
    }
    Show("early", EARLY.GetValue());
    Show("early", EARLY_RANGE.GetSpan().GetValue());
    Show("sum", (2.0 * EARLY - CRadians::PI_OVER_FOUR + CRadians(0.1)).GetValue());
}

static void Ranges()
{
    CRange<Real> range(-1.0, 3.0), other(10.0, 20.0);
    const Real values[] = {-2.0, -1.0, 0.3, 3.0, 4.0, 11.5};
    for (Real value : values) {
        Real truncated = value, wrapped = value, mapped;
        range.TruncValue(truncated);
        range.WrapValue(wrapped);
        range.MapValueIntoRange(mapped, value, other);
        Show("truncated", truncated);
        Show("wrapped", wrapped);
        Show("mapped", mapped);
        Show("normalized", range.NormalizeValue(value));
        Show("within", range.WithinMinBoundIncludedMaxBoundIncluded(value));
        Show("within", range.WithinMinBoundExcludedMaxBoundExcluded(value));
    }
    Show("range", ToString(range) + " " + ToString(FromString<CRange<Real> >("1.5:2.5").GetMax()));
}

static void Vectors()
{
    CVector2 a(1.5, -2.0), b(2.0, CRadians(0.5));
    CVector3 c(1.0, 2.0, -0.5), d(1.5, CRadians(0.7), CRadians(2.0));
    CRadians inclination, azimuth;
    CVector2 flat;
    Real length;

    Show("v2", a + b);
    Show("v2", 2.0 * a - b / 3.0);
    Show("v2", CVector2(a).Normalize());
    Show("v2", CVector2(a).Rotate(CRadians(1.0)));
    Show("v2", CVector2(a).Perpendicularize());
    Show("v2", CVector2(a).Scale(2.0, 3.0).Absolute());
    Show("v2", a.DotProduct(b));
    Show("v2", a.CrossProduct(b));
    Show("v2", a.Angle().GetValue());
    Show("v2", Distance(a, b));
    Show("v2", SquareDistance(a, b));
    Show("v2", ToString(a) + " " + ToString(FromString<CVector2>("3,-4.5")));
    Show("v3", c + d);
    Show("v3", -c * 2.0 - d / 4.0);
    Show("v3", CVector3(c).Normalize());
    Show("v3", CVector3(c).RotateX(CRadians(0.3)));
    Show("v3", CVector3(c).RotateY(CRadians(0.3)));
    Show("v3", CVector3(c).RotateZ(CRadians(0.3)));
    Show("v3", CVector3(c).CrossProduct(d));
    Show("v3", CVector3(c).Rotate(CQuaternion(CRadians(0.8), EARLY_VECTOR)));
    Show("v3", CVector3(c).Negate().ProjectOntoXZ(flat));
    Show("v3", c.DotProduct(d));
    Show("v3", c.GetZAngle().GetValue());
    Show("v3", CVector3(c).GetAngleWith(d).GetValue());
    d.ToSphericalCoords(length, inclination, azimuth);
    Show("v3", CVector3(length, inclination.GetValue(), azimuth.GetValue()));
    Show("v3", c < d);
    Show("v3", ToString(c) + " " + ToString(FromString<CVector3>("3,-4.5,1e-3")));
}

static void Quaternions()
{
    CQuaternion turn, about(CRadians(1.2), CVector3::Y);
    turn.FromEulerAngles(CRadians(0.4), CRadians(-0.3), CRadians(1.1));
    Show("q", turn);
    Show("q", about);
    Show("q", turn * about);
    Show("q", (turn + about).Normalize());
    Show("q", turn.Inverse());
    Show("q", CQuaternion().FromEulerAngles(CRadians(2.0), CRadians(), CRadians()));
    Show("q", CQuaternion().FromEulerAngles(CRadians(0.5), CRadians::PI_OVER_TWO, CRadians()));
    Show("q", CQuaternion(CVector3::X, CVector3(1.0, 1.0, 0.2)));
    Show("q", CQuaternion(CVector3::X, CVector3(-1.0, 0.0, 0.0)));
    Show("q", ToString(turn));
    Show("q", FromString<CQuaternion>("90,0,0"));
}

static void Colors()
{
    CColor color, over(200, 100, 50, 128);
    Show("color", ToString(EARLY_COLOR) + ToString(CColor(1, 2, 3)));
    color.Set("purple");
    Show("color", color.GetRed());
    color.Set("7,8,9,10");
    Show("color", color.GetAlpha());
    Show("color", over.ToGrayScale());
    Show("color", over.Blend(CColor::GRAY30).GetGreen());
    Show("color", over == CColor(200, 100, 50, 128));
    Show("color", static_cast<UInt32>(over));
}

static void Random()
{
    CRandom::CreateCategory("argos", 12345);
    CRandom::CRNG *first = CRandom::CreateRNG("argos"), *second = CRandom::CreateRNG("argos");
    Show("seed", first->GetSeed());
    Show("seed", second->GetSeed());
    for (int i = 0; i < 700; ++i)
        first->Uniform(CRange<Real>(0.0, 1.0));
    for (int i = 0; i < 3; ++i) {
        Show("real", first->Uniform(CRange<Real>(-1.0, 4.0)));
        Show("whole", first->Uniform(CRange<SInt32>(-5, 100)));
        Show("natural", first->Uniform(CRange<UInt32>(3, 1000000)));
        Show("angle", first->Uniform(CRadians::UNSIGNED_RANGE).GetValue());
        Show("bernoulli", second->Bernoulli(0.3));
        Show("gauss", first->Gaussian(2.0, 1.0));
        Show("exponential", second->Exponential(3.0));
        Show("poisson", second->Poisson(4.5));
        Show("rayleigh", second->Rayleigh(1.5));
        Show("lognormal", second->Lognormal(0.5, 0.1));
    }
    std::vector<int> cards;
    for (int i = 0; i < 10; ++i)
        cards.push_back(i);
    first->Shuffle(cards);
    for (int card : cards)
        Show("card", card);
    Show("again", CRandom::CreateCategory("argos", 1));
    Show("seed", CRandom::GetSeedOf("argos"));
    CRandom::SetSeedOf("argos", 99);
    CRandom::GetCategory("argos").ResetRNGs();
    Show("seed", second->GetSeed());
    Show("real", second->Uniform(CRange<Real>(0.0, 1.0)));
    Show("exists", CRandom::ExistsCategory("mine"));
}

static void Bytes()
{
    CByteArray bytes;
    UInt16 small;
    SInt32 whole;
    UInt64 large;
    SInt8 tiny;
    double number;
    float narrow;
    std::string text;
    const double numbers[] = {0.0, 1.0, -0.1, 3.14159, -1e-30, 123456789.125, 0.5};

    bytes << static_cast<UInt16>(258) << static_cast<SInt32>(-3) << static_cast<UInt64>(1) << "ab";
    bytes << static_cast<SInt8>(-2) << 1.5f;
    for (double each : numbers)
        bytes << each;
    for (size_t i = 0; i < bytes.Size(); ++i)
        Show("byte", bytes[i]);
    bytes >> small >> whole >> large >> text >> tiny >> narrow;
    Show("taken", small);
    Show("taken", whole);
    Show("taken", static_cast<double>(large));
    Show("taken", text);
    Show("taken", tiny);
    Show("taken", narrow);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; ++i) {
        bytes >> number;
        Show("taken", number);
    }
    Show("taken", bytes.Empty());
}

static void Texts()
{
    std::vector<std::string> tokens;
    std::string text("one two  one"), variable("a$VSENSE_TEST/b");
    UInt32 values[3];
    Real numbers[2];

    Tokenize(" --fsm a,b  c", tokens, " ,");
    for (const std::string &token : tokens)
        Show("token", token);
    Replace(text, "one", "three");
    Show("replaced", text);
    Show("case", StringToUpperCase("aBc9") + StringToLowerCase("aBc9"));
    ParseValues<UInt32>(std::string("1,22,333"), 3, values, ',');
    Show("parsed", values[2]);
    ParseValues<Real>(std::string("-1e3, .5"), 2, numbers, ',');
    Show("parsed", numbers[0] + numbers[1]);
    Show("match", MatchPattern("epuck_12", "^epuck_[0-9]+$"));
    Show("match", MatchPattern("epuck_x", "^epuck_[0-9]+$"));
    Show("string", ToString(0.1 + 0.2) + ToString(1e10) + ToString(true) + ToString(-7));
    Show("string", ToString(123456.0) + " " + ToString(1234567.0) + " " + ToString(2.0f));
    Show("expanded", ExpandEnvVariables(variable));
    Show("from", FromString<SInt32>(" 42 robots"));
    Show("from", FromString<Real>("2.5e-1"));
}

static void Configuration()
{
    TConfigurationNode tree("params"), child("distribute"), empty;
    UInt32 count;
    Real radius, absent;
    bool flag;
    UInt8 byte;
    std::string text;
    CVector3 place;
    CRange<CRadians> range;
    TConfigurationNodeIterator it("distribute");

    SetNodeAttribute(tree, "count", 12);
    SetNodeAttribute(tree, "radius", 0.25);
    SetNodeAttribute(tree, "flag", true);
    SetNodeAttribute(tree, "byte", static_cast<UInt8>(200));
    tree.SetAttribute("place", "1,2,-3.5");
    tree.SetAttribute("range", "0.5:1.5");
    SetNodeAttribute(child, "id", std::string("first"));
    AddChildNode(tree, child);
    SetNodeAttribute(child, "id", std::string("second"));
    AddChildNode(tree, child);
    GetNodeAttribute(tree, "count", count);
    GetNodeAttribute(tree, "radius", radius);
    GetNodeAttribute(tree, "flag", flag);
    GetNodeAttribute(tree, "byte", byte);
    GetNodeAttribute(tree, "place", place);
    GetNodeAttribute(tree, "range", range);
    GetNodeAttributeOrDefault(tree, "absent", absent, 7.5);
    GetNodeAttributeOrDefault(tree, "text", text, std::string("other"));
    Show("read", count + radius + flag + byte);
    for (const char *number : {"-3", "300", "-300", "70000"}) {
        UInt8 small;
        SInt8 signed_small;
        UInt16 medium = 0;
        tree.SetAttribute("number", number);
        GetNodeAttribute(tree, "number", small);
        GetNodeAttribute(tree, "number", signed_small);
        Show("cut", 1000.0 * small + signed_small);
        try {
            GetNodeAttribute(tree, "number", medium);
            Show("medium", static_cast<UInt32>(medium));
        }
        catch (CARGoSException &) {
            Show("medium", false);
        }
    }
    Show("read", place);
    Show("read", range.GetMax().GetValue());
    Show("read", text);
    Show("read", absent);
    for (it = it.begin(&tree); it != it.end(); ++it) {
        GetNodeAttribute(*it, "id", text);
        Show("child", it->Value() + text);
    }
    Show("exists", NodeExists(tree, "distribute") + 2 * NodeExists(tree, "nothing"));
    Show("exists", NodeAttributeExists(tree, "count"));
    empty = GetNode(tree, "distribute");
    Show("node", empty.Value());
}

static void Rays()
{
    const CRay2 flat(CVector2(0.3, -1.2), CVector2(2.1, 0.7));
    CRay3 ray(CVector3(1.0, 2.0, 3.0), CVector3(0.6, 0.0, -0.8), 2.5);
    CVector2 plane;
    CVector3 space;
    std::ostringstream text;
    Show("length", flat.GetLength());
    Show("distance", flat.GetDistance(-0.4));
    flat.GetPoint(plane, 1.5);
    Show("point", plane.GetX() + 10.0 * plane.GetY());
    flat.GetDirection(plane);
    Show("direction", plane.GetX() + 10.0 * plane.GetY());
    flat.GetInverseDirection(plane);
    Show("inverse", plane.GetX() + 10.0 * plane.GetY());
    flat.ToVector(plane);
    Show("vector", plane.GetX() + 10.0 * plane.GetY());
    Show("end", ray.GetEnd().GetX() + 10.0 * ray.GetEnd().GetZ());
    ray.SetLength(0.7);
    Show("length", ray.GetLength());
    Show("distance", ray.GetDistance(0.3));
    ray.GetPoint(space, 0.25);
    Show("point", space.GetX() + 10.0 * space.GetZ());
    Show("vector", ray.ToVector(space).GetX());
    ray.GetEnd().SetX(9.0);
    ray.SetStart(CVector3());
    text << flat << " " << ray;
    Show("rays", text.str());
    /* One digit each: long and short ones, parallel, touching, and such as miss. */
    std::string meets;
    CRandom::CRNG numbers(7);
    const CRange<Real> range(-1.5, 1.5);
    for (int i = 0; i < 200; ++i) {
        Real at[8];
        for (Real &each : at)
            each = i % 2 ? numbers.Uniform(range) : Round(numbers.Uniform(range) * 2.0) / 2.0;
        const CRay2 one(CVector2(at[0], at[1]), CVector2(at[2], at[3]));
        meets += one.Intersects(CRay2(CVector2(at[4], at[5]), CVector2(at[6], at[7]))) ? '1' : '0';
    }
    Show("meets", meets);
}

class CShape
{
public:
    virtual ~CShape() {}
    virtual int Corners() const = 0;
};

class CSquare : public CShape
{
public:
    int Corners() const override { return 4; }
};

class CBar : public CSquare
{
public:
    int Corners() const override { return 2; }
};

static void Factories()
{
    const std::string labels[] = {"bar", "square"};
    for (const std::string &label : labels) {
        CShape *shape = CFactory<CShape>::New(label);
        Show(label.c_str(), shape->Corners());
        delete shape;
    }
    Show("exists", CFactory<CShape>::Exists("bar") + 2 * CFactory<CShape>::Exists("round"));
    for (const auto &known : CFactory<CShape>::GetTypeMap())
        Show("known", known.first + " of " + known.second->Author);
}

/* What fails, and how: only that it does is ARGoS's, the words are not. */
template <typename F> static void Fails(const char *name, F call)
{
    try {
        call();
        Show(name, "works");
    } catch (CARGoSException &error) {
        Show(name, std::string("fails ") + std::string(error.what()).substr(0, 7));
    }
}

static void Failures()
{
    TConfigurationNode tree("params");
    tree.SetAttribute("word", "abc");
    tree.SetAttribute("number", "12abc");
    Fails("no attribute", [&] { Real r; GetNodeAttribute(tree, "absent", r); });
    Fails("no number", [&] { Real r; GetNodeAttribute(tree, "word", r); });
    Fails("half a number", [&] { UInt32 r; GetNodeAttribute(tree, "number", r); });
    Fails("no bool", [&] { bool r; GetNodeAttribute(tree, "word", r); });
    Fails("bad other", [&] { Real r; GetNodeAttributeOrDefault(tree, "word", r, 1.0); });
    Fails("no node", [&] { GetNode(tree, "absent"); });
    Fails("no category", [&] { CRandom::CreateRNG("absent"); });
    Fails("few values", [&] { Real r[3]; ParseValues<Real>(std::string("1,2"), 3, r, ','); });
    Fails("many values", [&] { Real r[2]; ParseValues<Real>(std::string("1,2,3"), 2, r, ','); });
    Fails("no color", [&] { CColor().Set("pink"); });
    Fails("no byte", [&] { CByteArray b(3, 1); UInt32 r; b >> r; });
    Fails("no class", [&] { CFactory<CShape>::New("round"); });
    Fails("other type", [&] { int i = 1; CAny a(&i); any_cast<float *>(a); });
    Fails("same type", [&] { int i = 1; CAny a(&i); Show("any", *any_cast<int *>(a)); });
    try {
        THROW_ARGOSEXCEPTION("a" << 1 << 'c' << 2.5 << std::string("s") << true << CVector2(1, 2));
    } catch (std::exception &error) {
        Show("what", error.what());
    }
}

int main()
{
    Numbers();
    Angles();
    Ranges();
    Vectors();
    Quaternions();
    Colors();
    Random();
    Bytes();
    Texts();
    Configuration();
    Rays();
    Factories();
    Failures();
    return 0;
}

REGISTER_SYMBOL(CShape, CSquare, "square", "A. Nobody", "1.0", "a shape", "of four sides", "new")
REGISTER_SYMBOL(CShape, CBar, "bar", "B. Nobody", "1.0", "a shape", "of one side", "new")
