/* SPDX-License-Identifier: MIT */
/*
 * loop_functions.cpp - calls ARGoS's loop functions for a host.
 *
 * A call is text: its first line names what is called, each further line is a word and what it
 * says, with tabs between. The host says
 *
 *     world      before all others, with seed, length [timestep], tick [s], file, moves (1: robots
 *                are moved), arena (size and centre x, y, z), model (id and model of a robot),
 *                robots (their ids), and the entities:
 *                    box       id x y z yaw size_x size_y size_z
 *                    cylinder  id x y z yaw radius height
 *                with place and colour of each LED on them, x y z red green blue
 *                    light     id x y z intensity red green blue
 *     construct  label
 *     Init       settings, each line of them after a "|" (configuration.hpp)
 *     Reset, PreStep, PostStep, IsExperimentFinished, PostExperiment, Destroy
 *     GetFloorColor, with two numbers for each point
 *
 * where all but the last take three numbers for each robot, its place x, y and yaw, and may have
 * the lines clock, robots where there are others now, and "shine NUMBER" of a robot whose LEDs show
 * something else, with red, green and blue of each. The answer has the lines
 *
 *     error WORDS, log WORDS, logerr WORDS, finished, floor, measure NAME VALUE, gone ID,
 *     robot ID x y z yaw and entities as above, for what has changed.
 */
#include "blocks.hpp"
#include "loop_functions.hpp"

#include <cstdint>

namespace argos {

namespace {

VsLoopKind *kinds = nullptr;
CLoopFunctions *loop = nullptr;
VsLoopKind *kind = nullptr;
std::vector<VsRobotEntity *> robots;
std::map<std::string, std::string> models; /* of robots, by id */
std::string said;
std::vector<UInt8> colors;
bool is_called = false; /* a loop function runs */

CSpace &Space()
{
    return CSimulator::GetInstance().GetSpace();
}

/* What a user says is one word of a line. */
void Say(const std::string &word, const std::string &what)
{
    std::string line(what);
    for (char &letter : line)
        if (letter == '\n' || letter == '\t')
            letter = ' ';
    said += word + "\t" + line + "\n";
}

Real Number(const std::vector<std::string> &words, size_t at)
{
    return at < words.size() ? std::strtod(words[at].c_str(), nullptr) : 0.0;
}

CVector3 Place(const std::vector<std::string> &words, size_t at)
{
    return CVector3(Number(words, at), Number(words, at + 1), Number(words, at + 2));
}

/* A line's words, an empty one at the end too. */
std::vector<std::string> Words(const std::string &line)
{
    return VsParts(line + "\t", '\t');
}

CColor Color(const std::vector<std::string> &words, size_t at)
{
    return CColor(static_cast<UInt8>(Number(words, at)), static_cast<UInt8>(Number(words, at + 1)),
                  static_cast<UInt8>(Number(words, at + 2)));
}

/* The LEDs of an obstacle, from a word on; the host knows them already. */
void TakeLEDs(VsObstacle &obstacle, const std::vector<std::string> &words, size_t from)
{
    for (size_t at = from; at + 5 < words.size(); at += 6)
        obstacle.AddLED(Place(words, at), Color(words, at + 3));
    obstacle.VsTakeChange();
}

void TakeEntity(const std::vector<std::string> &words)
{
    const CQuaternion turn(CRadians(Number(words, 5)), CVector3::Z);
    if (words[0] == "box") {
        CBoxEntity *box = new CBoxEntity(words[1], Place(words, 2), turn, false, Place(words, 6));
        TakeLEDs(*box, words, 9);
        Space().AddEntity(*box);
    } else if (words[0] == "cylinder") {
        CCylinderEntity *post = new CCylinderEntity(words[1], Place(words, 2), turn, false,
                                                    Number(words, 6), Number(words, 7));
        TakeLEDs(*post, words, 8);
        Space().AddEntity(*post);
    } else if (words[0] == "light")
        Space().AddEntity(*new CLightEntity(words[1], Place(words, 2),
                                            Color(words, 6), Number(words, 5)));
}

/* Those that are no longer there are taken out, and new ones come. */
void TakeRobots(const std::vector<std::string> &words)
{
    std::vector<VsRobotEntity *> now;
    for (size_t i = 1; i < words.size(); ++i) {
        VsRobotEntity *found = nullptr;
        for (VsRobotEntity *robot : robots)
            if (robot->GetId() == words[i])
                found = robot;
        if (found == nullptr && !words[i].empty()) {
            found = VsAddRobot(words[i], models[words[i]]);
        }
        if (found != nullptr)
            now.push_back(found);
    }
    for (VsRobotEntity *robot : robots)
        if (std::find(now.begin(), now.end(), robot) == now.end())
            Space().VsRemove(*robot);
    robots = now;
}

struct World
{
    UInt32 seed = 0, length = 0;
    bool moves = false;
    std::string file;
};

/* What was there before belongs to another run. */
void Forget()
{
    loop = nullptr;
    robots.clear();
    models.clear();
    CSimulator::GetInstance().VsForget();
}

void TakeWorld(const std::vector<std::string> &lines)
{
    World world;
    Forget();
    for (const std::string &line : lines) {
        const std::vector<std::string> words = Words(line);
        if (words[0] == "seed")
            world.seed = static_cast<UInt32>(Number(words, 1));
        else if (words[0] == "length")
            world.length = static_cast<UInt32>(Number(words, 1));
        else if (words[0] == "tick")
            CPhysicsEngine::VsTick() = Number(words, 1);
        else if (words[0] == "file")
            world.file = words[1];
        else if (words[0] == "moves")
            world.moves = words[1] == "1";
        else if (words[0] == "arena")
            Space().VsSetArena(Place(words, 1), Place(words, 4));
        else if (words[0] == "model")
            models[words[1]] = words[2];
    }
    CSimulator::GetInstance().VsSet(world.seed, world.length, world.moves, world.file);
    for (const std::string &line : lines) {
        const std::vector<std::string> words = Words(line);
        if (words[0] == "robots")
            TakeRobots(words);
        else
            TakeEntity(words);
    }
}

void Construct(const std::string &label)
{
    std::string known;
    for (kind = kinds; kind != nullptr && label != kind->label; kind = kind->next)
        known += std::string(known.empty() ? "'" : ", '") + kind->label + "'";
    if (kind == nullptr)
        THROW_ARGOSEXCEPTION("no loop functions are registered as '"
                             << label << "', expected: "
                             << (known.empty() ? "a REGISTER_LOOP_FUNCTIONS" : known));
    loop = kind->make();
}

void Init(const std::vector<std::string> &lines)
{
    std::string settings;
    for (const std::string &line : lines)
        if (line[0] == '|')
            settings += line.substr(1) + "\n";
    TConfigurationNode &root = CSimulator::GetInstance().GetConfigurationRoot();
    loop->Init(*root.InsertEndChild(VsReadConfiguration(settings)));
}

void End()
{
    loop->PostExperiment();
    const Real objective = kind->objective(*loop);
    char text[40];
    std::snprintf(text, sizeof text, "objective\t%.17g", objective);
    if (!std::isnan(objective))
        said += std::string("measure\t") + text + "\n";
}

/* Entities that stood there from the start go back; those that were added stay where they are put
 * again, as the host's world has lost them. */
void Reset()
{
    CSimulator::GetInstance().VsReset();
    for (CEntity *entity : Space().GetRootEntityVector())
        if (dynamic_cast<VsRobotEntity *>(entity) == nullptr)
            entity->Reset();
    loop->Reset();
}

void Destroy()
{
    loop->Destroy();
    delete loop;
    loop = nullptr;
}

void Color(const double *numbers, size_t count)
{
    colors.clear();
    for (size_t i = 0; i + 1 < count; i += 2) {
        const CColor color = loop->GetFloorColor(CVector2(numbers[i], numbers[i + 1]));
        colors.push_back(color.GetRed());
        colors.push_back(color.GetGreen());
        colors.push_back(color.GetBlue());
    }
}

/* A robot may have fewer LEDs than the one that has the most. */
void Shine(CLEDEquippedEntity &leds, const std::vector<std::string> &words)
{
    const size_t count = leds.GetLEDs().size();
    for (size_t i = 2; i + 2 < words.size() && (i - 2) / 3 < count; i += 3)
        leds.SetLEDColor(static_cast<UInt32>((i - 2) / 3), Color(words, i));
}

void TakeState(const std::vector<std::string> &lines, const double *numbers, size_t count)
{
    for (const std::string &line : lines) {
        const std::vector<std::string> words = Words(line);
        if (words[0] == "clock")
            Space().SetSimulationClock(static_cast<UInt32>(Number(words, 1)));
        else if (words[0] == "robots")
            TakeRobots(words);
        else if (words[0] == "shine" && Number(words, 1) < robots.size())
            Shine(robots[static_cast<size_t>(Number(words, 1))]->GetLEDEquippedEntity(), words);
    }
    for (size_t i = 0; i < robots.size() && 3 * i + 2 < count; ++i)
        robots[i]->GetEmbodiedEntity().VsPlace(numbers[3 * i], numbers[3 * i + 1],
                                               numbers[3 * i + 2]);
}

void SayChanges()
{
    LOG.Flush();
    LOGERR.Flush();
    for (CEntity *entity : Space().GetRootEntityVector())
        if (entity->VsTakeChange())
            said += entity->VsDescribe() + "\n";
    if (Space().GetFloorEntity().HasChanged()) {
        Space().GetFloorEntity().ClearChanged();
        said += "floor\n";
    }
}

void Call(const std::string &what, const std::vector<std::string> &lines, const double *numbers,
          size_t count)
{
    if (what == "world")
        return TakeWorld(lines);
    if (what == "construct")
        return Construct(lines.empty() ? "" : lines[0]);
    if (loop == nullptr)
        THROW_ARGOSEXCEPTION("there are no loop functions yet");
    if (what == "GetFloorColor")
        return Color(numbers, count);
    TakeState(lines, numbers, count);
    if (what == "Init")
        Init(lines);
    else if (what == "Reset")
        Reset();
    else if (what == "PreStep")
        loop->PreStep();
    else if (what == "PostStep")
        loop->PostStep();
    else if (what == "PostExperiment")
        End();
    else if (what == "Destroy")
        Destroy();
    else if (what == "IsExperimentFinished" &&
             (CSimulator::GetInstance().VsIsTerminated() || loop->IsExperimentFinished()))
        said += "finished\n";
}

}  // namespace

VsLoopKind::VsLoopKind(const char *its_label, CLoopFunctions *(*makes)(),
                       Real (*gives)(CLoopFunctions &))
    : label(its_label), make(makes), objective(gives), next(kinds)
{
    kinds = this;
    CFactory<CLoopFunctions>::Register(label, "", "", "", "", "", make);
}

/* ------------------------------------------------------------------ the simulator */

Real &CPhysicsEngine::VsTick()
{
    static Real tick = 0.1;
    return tick;
}

CSimulator &CSimulator::GetInstance()
{
    static CSimulator simulator;
    return simulator;
}

CLoopFunctions &CSimulator::GetLoopFunctions()
{
    return *loop;
}

void CSimulator::VsSet(UInt32 seed, UInt32 max_clock, bool moves_robots, const std::string &file)
{
    m_seed = seed;
    m_max_clock = max_clock;
    m_moves_robots = moves_robots;
    m_file = file;
    CRandom::CreateCategory("argos", seed);
}

void CSimulator::VsForget()
{
    if (CRandom::ExistsCategory("argos"))
        CRandom::RemoveCategory("argos");
    m_space = CSpace();
    m_root = TConfigurationNode("argos-configuration");
    m_rng = nullptr;
    m_terminated = false;
}

CRandom::CRNG *CSimulator::GetRNG()
{
    if (m_rng == nullptr)
        m_rng = CRandom::CreateRNG("argos");
    return m_rng;
}

void CSimulator::VsReset()
{
    m_terminated = false;
    m_space.SetSimulationClock(0);
    CRandom::SetSeedOf("argos", m_seed);
    CRandom::GetCategory("argos").ResetRNGs();
}

bool CSimulator::IsExperimentFinished()
{
    const bool over = m_max_clock > 0 && m_space.GetSimulationClock() >= m_max_clock;
    return m_terminated || over || loop->IsExperimentFinished();
}

/* ------------------------------------------------------------------ loop functions */

void CLoopFunctions::MoveEntity(CPositionalEntity &entity, const CVector3 &position,
                                const CQuaternion &orientation)
{
    entity.MoveTo(position, orientation);
}

bool CLoopFunctions::MoveEntity(CEmbodiedEntity &entity, const CVector3 &position,
                                const CQuaternion &orientation, bool check_only,
                                bool ignore_collisions)
{
    return entity.MoveTo(position, orientation, check_only, ignore_collisions);
}

void CLoopFunctions::AddEntity(CEntity &entity)
{
    if (CBoxEntity *box = dynamic_cast<CBoxEntity *>(&entity))
        GetSpace().AddEntity(*box);
    else if (CCylinderEntity *cylinder = dynamic_cast<CCylinderEntity *>(&entity))
        GetSpace().AddEntity(*cylinder);
    else if (CLightEntity *light = dynamic_cast<CLightEntity *>(&entity))
        GetSpace().AddEntity(*light);
    else if (CArenaEntity *arena = dynamic_cast<CArenaEntity *>(&entity))
        GetSpace().AddEntity(*arena);
    else
        THROW_ARGOSEXCEPTION("AddEntity: \"" << entity.GetId() << "\" is a "
                             << entity.GetTypeDescription()
                             << ": boxes, cylinders and lights can be added, robots are those of"
                                " the experiment file; write <distribute> there, or <vs:robot>s"
                                " for virtual ones");
    entity.VsChange();
}

void CLoopFunctions::RemoveEntity(const std::string &id)
{
    RemoveEntity(GetSpace().GetEntity(id));
}

void CLoopFunctions::RemoveEntity(CEntity &entity)
{
    if (dynamic_cast<VsRobotEntity *>(&entity) != nullptr || entity.HasParent())
        THROW_ARGOSEXCEPTION("RemoveEntity: \"" << entity.GetId() << "\" is a "
                             << entity.GetTypeDescription()
                             << ": boxes, cylinders and lights can be removed");
    if (CArenaEntity *arena = dynamic_cast<CArenaEntity *>(&entity)) {
        for (CWallEntity *wall : arena->GetWalls())
            for (CBlockEntity *block : wall->GetBlocks())
                said += "gone\t" + block->GetId() + "\n";
    } else
        said += "gone\t" + entity.GetId() + "\n";
    GetSpace().VsRemove(entity);
}

}  // namespace argos

bool argos::VsLoopLogs(bool is_error, const char *line)
{
    if (is_called)
        Say(is_error ? "logerr" : "log", line);
    return is_called;
}

#ifndef VS_ARGOS_TOGETHER
extern "C" void vs_argos_log(int is_error, const char *line)
{
    argos::VsLoopLogs(is_error, line);
}

extern "C" void vs_argos_fail(const char *words)
{
    throw std::runtime_error(words);
}
#endif

/* What a user throws ends here: nothing of C++ reaches the host. */
extern "C" void vs_cxx_call(const char *text, size_t size, const double *numbers, size_t count,
                            struct vs_cxx_answer *answer)
{
    using namespace argos;
    std::vector<std::string> lines = VsParts(std::string(text, size), '\n');
    const std::string what = lines.empty() ? "" : lines[0];
    said.clear();
    colors.clear();
    is_called = true;
    try {
        lines.erase(lines.begin(), lines.begin() + !lines.empty());
        Call(what, lines, numbers, count);
    } catch (const std::exception &error) {
        Say("error", error.what());
    } catch (...) {
        Say("error", "something was thrown that is no std::exception");
    }
    SayChanges();
    is_called = false;
    answer->text = said.data();
    answer->text_size = said.size();
    answer->colors = colors.data();
    answer->color_count = colors.size();
}
