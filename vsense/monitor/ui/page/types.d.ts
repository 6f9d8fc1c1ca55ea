// The messages that reach the page, as ../MESSAGES.md describes them, and what its scripts share.
// For `tsc --checkJs` only (tests/monitor/ui/test_page_sources.py): no browser ever loads this file.

type Vector = [number, number, number];
type Point = [number, number];
type Colour = [number, number, number];

/** `/experiment`. */
interface ExperimentMessage {
  mode: "live" | "sim" | "replay" | "track";
  command: string;
  user: string | null;
  name: string;
  seed: number | null;
  blind: boolean;
  homes?: boolean | null;
  timestep_s: number;
  length_s: number | null;
  arena: { size_m: Vector; centre_m: Vector; fence?: Fence };
  robots: { tag: number; name: string; height_m: number; radius_m?: number; driven_here?: boolean }[];
  objects: { tag: number; name: string; radius_m?: number }[];
  controllers: Controller[];
  cameras: CameraDescription[];
  body_radius_m: number;
  body_height_m?: number;
  made: { series?: PlannedRun } | null;
}

interface Fence {
  boundary: Point[];
  forbidden: Point[][];
  keep_off: { tag: number; distance_m: number }[];
}

interface Controller {
  id: string;
  tags: number[];
  sensors: Sensor[];
}

interface Sensor {
  name: string;
  layout: string;
  count: number;
  angles_rad: number[] | null;
}

interface CameraDescription {
  id: string;
  tracker: string;
  width_px: number; height_px: number;
  row: number; column: number;
  model: CameraModel | null;
  mask_px?: Point[][];
}

/** As vsense/vision/cameras/camera.py writes it. */
interface CameraModel {
  width_px: number; height_px: number;
  fx_px: number; fy_px: number;
  cx_px: number; cy_px: number;
  distortion: [number, number, number, number, number];
  rotation: [number, number, number, number, number, number, number, number, number];
  position_m: Vector;
}

interface PlannedRun {
  name: string; number: number; of: number;
  attempt: number; condition: string; start: string; repetition: number;
}

/** `/run`. */
interface RunMessage {
  state: string;
  run: number;
  runs: number | null;
  timestep: number;
  time_s: number;
  length_s: number | null;
  text: string;
  by: string | null;
  can: string[];
  rate_hz: number | null;
  late: number | null;
  latency_ms: { p50: number; p99: number } | null;
  silent_s: number | null;
  recording: { on: boolean; file: string | null; bytes: number; lost_messages: number; trouble: string | null } | null;
  disk_free_bytes: number | null;
  doubts?: string[];
  alarms?: { kind: string; text: string; cause: string }[];
  spares?: number[];
  verdict?: string | null;
  why?: string;
  replay?: ReplayState | null;
  sim?: { speed: number | null; reached: number } | null;
}

interface ReplayState {
  position_s: number; begin_s?: number; duration_s: number; speed: number;
  playing: boolean; pictures?: boolean;
}

/** `/arena`. */
interface ArenaMessage {
  timestep: number;
  run_timestep: number;
  capture_ns: number;
  robots: {
    tag: number[]; x_m: number[]; y_m: number[]; yaw_rad: number[]; speed_m_s: number[];
    age_ns: number[]; seen: boolean[];
  };
  cameras: string[];
  images: { tag: number[]; camera: number[]; x_px: number[]; y_px: number[]; yaw_px_rad: number[] };
}

/** `/world`. */
interface WorldMessage {
  entities: Entity[];
  floor: Floor | null;
}

interface Floor {
  color: Colour;
  size_m: Point;
  centre_m: Point;
  png: string | null;
}

type Entity = Box | Cylinder | Light | Zone | VirtualRobot;

interface Box {
  kind: "box";
  id: string;
  position_m: Vector;
  size_m: Vector;
  yaw_rad: number;
  physical: boolean;
}

interface Cylinder {
  kind: "cylinder";
  id: string;
  position_m: Vector;
  radius_m: number;
  height_m: number;
  physical: boolean;
}

interface Light {
  kind: "light";
  id: string;
  position_m: Vector;
  intensity: number;
  color: Colour;
}

interface Zone {
  kind: "zone";
  id: string;
  shape: "circle" | "rectangle";
  x_m: number; y_m: number;
  radius_m: number; size_m: Point; yaw_rad: number;
  color: Colour | null;
  value: number;
}

interface VirtualRobot {
  kind: "robot";
  id: string;
  tag: number; x_m: number; y_m: number; yaw_rad: number;
  model?: string; radius_m?: number; height_m?: number;
}

/** `/signals`. */
interface SignalsMessage {
  timestep: number;
  time_s: number;
  leds: { tag: number[]; color: Colour[] };
  cones: { x_m: number[]; y_m: number[] }[];
  measures: Record<string, number>;
}

/** `/history`. */
interface HistoryMessage {
  run: number;
  bucket_s: number;
  time_s: number[];
  measures: Record<string, Record<"low" | "high" | "last", (number | null)[]>>;
}

/** `/fields`. */
interface FieldsMessage {
  fields: Field[];
}

interface Field {
  id: string;
  corner_m: Point;
  cell_m: number;
  columns: number;
  rows: number;
  peak: number;
  levels: string;
}

/** `/readings` and `/readings/TAG`. */
interface ReadingsMessage {
  timestep: number;
  capture_ns: number;
  tag: number[];
  values: (number | null)[][][];
  captured_ns: number[][];
}

/** `/robots`, in columns; what older recordings lack may be missing. */
interface RobotsMessage {
  tag: number[];
  name: string[];
  connected: boolean[];
  heard_ms: (number | null)[];
  udp: (boolean | null)[];
  pose_age_ms: (number | null)[];
  seen: boolean[];
  doubt: (string | null)[];
  state: string[];
  stop_cause: string[];
  battery_mv: (number | null)[];
  battery_low: (boolean | null)[];
  leds: (number | null)[];
  left_steps_s: (number | null)[];
  right_steps_s: (number | null)[];
  base_errors: (number | null)[];
  signal_dbm?: (number | null)[];
  bit_rate_mbit_s?: (number | null)[];
  retries?: (number | null)[];
  power_saving?: (boolean | null)[];
  controller: (string | null)[];
  hash: (string | null)[];
  expected?: (string | null)[];
  authenticated?: (boolean | null)[];
  held?: (string | null)[];
  shown?: (Record<string, number | string | null> | null)[];
  trouble: string[];
}

/** One row of `/robots`. */
type RobotRow = { [Name in keyof RobotsMessage]: NonNullable<RobotsMessage[Name]>[number] };

/** `/cameras`. */
interface CamerasMessage {
  cameras: CameraState[];
}

interface CameraState {
  id: string;
  rate_hz: number | null;
  dropped: number;
  state: string;
  text: string;
}

/** `/parts`. */
interface PartsMessage {
  part: number[];
  tag: (number | null)[];
  uid: (string | null)[];
}

/** `/settings`. */
interface SettingsMessage {
  locked: boolean;
  sensors: ({ controller: string; name: string } & Settings)[];
  fields: ({ id: string } & Settings)[];
  params: Settings;
  things: Record<string, string[]>;
}

type Settings = Record<string, number | string>;

/** `/event`. */
interface EventMessage {
  text: string;
  level?: "info" | "warning" | "trouble";
  by: string | null;
  time_s?: number | null;
}

/** `/picture/CAMERA`, without its bytes. */
interface PictureMessage {
  camera: string;
  timestep: number;
  capture_ns: number;
  format: "jpeg" | "png";
}

/** `/you`. */
interface ViewerMessage {
  viewer: string;
  control: boolean;
  viewers: number;
}

/** `/answer`. */
interface AnswerMessage {
  text: string;
  ok: boolean;
  change?: boolean;
}

/** What the page says of itself. */
type Sentence =
  | { order: string; value: number; pair?: Point }
  | { change: WorldChange }
  | { look: number[] }
  | { refresh: boolean }
  | { pictures: string[] }
  | { got: number };

type WorldChange =
  | { kind: "move"; name: string; x_m: number; y_m: number; final?: boolean }
  | { kind: "set"; setting: string; value: number | string; name?: string; controller?: string }
  | { kind: "add"; x_m: number; y_m: number }
  | { kind: "remove"; name: string };

// -- what the page's scripts share ----------------------------------------------------------

type Store = import("./store.js").Store;
type Connection = import("./connection.js").Connection;
type Controls = import("./controls.js").Controls;
type Arena = import("./arena.js").Arena;
type Lens = import("./lens.js").Lens;
type Brush = import("./brush.js").Brush;
type Scene = import("./scene.js").Scene;

/** The newest reading of one sensor; `age_ns` is null before its first. */
interface SensorReading {
  sensor: Sensor;
  values: (number | null)[];
  age_ns: number | null;
}

/** The robot whose senses are shown. */
interface RobotSelection {
  tag: number | null;
  choose(tag: number | null): void;
}

/** Says something for a moment. */
type Notify = (text: string, ok: boolean) => void;

/** Numbers of one time; null: there are none. */
type ChartValues = (number | null | undefined)[] | null;

/** What a chart shows over time. */
interface ChartSource {
  key: string;
  label: string;
  unit?: string;
  tag?: number;
  now(store: Store): ChartValues;
}

/** An outline on the floor. */
type Shape = { centre: Point; radius: number } | { corners: Point[] };

/** A place in a picture, and the pixels of a metre there. */
type Spot = [x: number, y: number, zoom: number];

type Pen = CanvasRenderingContext2D;

/** Where places of the arena are in a picture. Paths are added to the pen's. */
interface View {
  /** From above: heights do not count, and what is real is not seen beneath. */
  flat: boolean;
  /** Pixels of the canvas in one of the screen. */
  ratio: number;
  spot(point: Vector): Spot | null;
  /** What is to be seen of an outline's area, at a height. */
  area(pen: Pen, shape: Shape, z: number): void;
  /** What is to be seen of an outline, at a height. */
  outline(pen: Pen, shape: Shape, z: number): void;
  line(pen: Pen, points: Vector[]): void;
}

/** Elements that are more than an HTMLElement, by their ids. */
interface PageElements {
  arena: HTMLCanvasElement;
  near: HTMLCanvasElement;
  picture: HTMLCanvasElement;
  watch: HTMLTableElement;
  robots: HTMLTableElement;
  points: HTMLTableElement;
  readings: HTMLTableSectionElement;
  keys: HTMLDialogElement;
  seek: HTMLInputElement;
  edit_value: HTMLInputElement;
  edit_target: HTMLSelectElement;
  edit_setting: HTMLSelectElement;
  replace_by: HTMLSelectElement;
  replace_do: HTMLButtonElement;
  sim_speed: HTMLSelectElement;
  speed: HTMLSelectElement;
  save: HTMLButtonElement;
}

type ElementOf<Id extends string> = Id extends keyof PageElements ? PageElements[Id] : HTMLElement;

interface Window {
  vsense: object;
}

interface HTMLElement {
  /** See `chartable` in series.js. */
  chart?: ChartSource | null;
}
