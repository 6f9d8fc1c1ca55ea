/* SPDX-License-Identifier: MIT */
/*
 * main.c - a robot on an ESP32 with ESP-IDF: sockets over Wi-Fi, its own motors. A host that was
 * started again is greeted again; where Wi-Fi is gone, the wheels stand and it is joined anew.
 */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/select.h>
#include <sys/socket.h>

#include "esp_err.h"
#include "esp_event.h"
#include "esp_mac.h"
#include "esp_netif.h"
#include "esp_random.h"
#include "esp_timer.h"
#include "esp_wifi.h"
#include "nvs_flash.h"

#include "../robot.h"
#include "motors.h"

/* Of the experiment: `vsense run` says its address and port. */
#ifndef HOST_ADDRESS
#define HOST_ADDRESS "192.168.1.10"
#endif
#ifndef HOST_PORT
#define HOST_PORT 4050
#endif
#ifndef ROBOT_TAG
#define ROBOT_TAG 23
#endif
#ifndef WIFI_NAME
#define WIFI_NAME "lab"
#define WIFI_PASSWORD "secret"
#endif

static struct robot robot;
static int stream = -1, datagrams = -1;
static uint8_t buffer[VS_DATAGRAM_MAX];

static uint64_t now_ns(void)
{
    return (uint64_t)esp_timer_get_time() * 1000u + 1000u;
}

static void join_again(void *unused, esp_event_base_t base, int32_t id, void *data)
{
    (void)unused, (void)base, (void)id, (void)data;
    (void)esp_wifi_connect();
}

static void join_wifi(void)
{
    wifi_init_config_t defaults = WIFI_INIT_CONFIG_DEFAULT();
    wifi_config_t config = {.sta = {.ssid = WIFI_NAME, .password = WIFI_PASSWORD}};

    ESP_ERROR_CHECK(nvs_flash_init());
    ESP_ERROR_CHECK(esp_netif_init());
    ESP_ERROR_CHECK(esp_event_loop_create_default());
    (void)esp_netif_create_default_wifi_sta();
    ESP_ERROR_CHECK(esp_wifi_init(&defaults));
    ESP_ERROR_CHECK(esp_event_handler_register(WIFI_EVENT, WIFI_EVENT_STA_START, join_again, NULL));
    ESP_ERROR_CHECK(
        esp_event_handler_register(WIFI_EVENT, WIFI_EVENT_STA_DISCONNECTED, join_again, NULL));
    ESP_ERROR_CHECK(esp_wifi_set_mode(WIFI_MODE_STA));
    ESP_ERROR_CHECK(esp_wifi_set_config(WIFI_IF_STA, &config));
    ESP_ERROR_CHECK(esp_wifi_start());
    ESP_ERROR_CHECK(esp_wifi_set_ps(WIFI_PS_NONE)); /* else packets wait for 100 ms and more */
}

static void hang_up(void)
{
    if (stream >= 0)
        close(stream);
    if (datagrams >= 0)
        close(datagrams);
    stream = datagrams = -1;
    vs_session_disconnected(&robot.session);
}

static int open_socket(int type)
{
    struct sockaddr_in host = {.sin_family = AF_INET, .sin_port = htons(HOST_PORT)};
    int made = socket(AF_INET, type, 0);

    host.sin_addr.s_addr = inet_addr(HOST_ADDRESS);
    if (made < 0)
        return -1;
    (void)fcntl(made, F_SETFL, O_NONBLOCK);
    if (connect(made, (struct sockaddr *)&host, sizeof host) == 0 || errno == EINPROGRESS)
        return made;
    close(made);
    return -1;
}

static void call_host(void)
{
    uint8_t nonce[VS_NONCE_SIZE];

    hang_up();
    esp_fill_random(nonce, sizeof nonce);
    robot_connected(&robot, nonce, now_ns());
    stream = open_socket(SOCK_STREAM);
    datagrams = open_socket(SOCK_DGRAM);
}

/* Until a byte comes, or for 5 ms. 1: the stream takes bytes. */
static int wait_a_moment(void)
{
    struct timeval moment = {.tv_usec = 5000};
    int most = stream > datagrams ? stream : datagrams;
    fd_set readable, writable;

    FD_ZERO(&readable);
    FD_ZERO(&writable);
    if (stream >= 0) {
        FD_SET(stream, &readable);
        if (robot.session.phase == VS_PHASE_CONNECT) /* its connection is being made */
            FD_SET(stream, &writable);
    }
    if (datagrams >= 0)
        FD_SET(datagrams, &readable);
    if (select(most + 1, &readable, &writable, NULL, &moment) < 0)
        return 0;
    return robot.session.phase != VS_PHASE_CONNECT || (stream >= 0 && FD_ISSET(stream, &writable));
}

static void read_all(void)
{
    ssize_t len;

    while (datagrams >= 0 && (len = recv(datagrams, buffer, sizeof buffer, 0)) > 0)
        robot_datagram(&robot, buffer, (size_t)len, now_ns());
    while (stream >= 0 && (len = recv(stream, buffer, sizeof buffer, 0)) != -1) {
        if (len == 0 || robot_bytes(&robot, buffer, (size_t)len, now_ns()) != VS_OK)
            hang_up();
    }
}

static void send_all(void)
{
    int is_telemetry;
    size_t len;

    while ((len = robot_packet(&robot, buffer, now_ns(), &is_telemetry)) > 0) {
        if (is_telemetry)
            (void)send(datagrams, buffer, len, MSG_NOSIGNAL); /* a lost one is like one lost in the air */
        if (is_telemetry && !vs_session_over_tcp(&robot.session, now_ns()))
            continue;
        if (send(stream, buffer, len, MSG_NOSIGNAL) != (ssize_t)len) {
            hang_up();
            return;
        }
    }
}

void app_main(void)
{
    struct vs_session_config config = {.tag = ROBOT_TAG, .cannot_home = 1};
    int16_t left_steps_s, right_steps_s;

    esp_fill_random(&config.started, sizeof config.started);
    ESP_ERROR_CHECK(esp_read_mac(config.uid, ESP_MAC_WIFI_STA)); /* 6 of 16 bytes: the others are 0 */
    strcpy(config.name, "esp32");
    strcpy(config.controller, "wide curve");
    strcpy(config.version, "example");
    motors_begin();
    join_wifi();
    ESP_ERROR_CHECK(robot_init(&robot, &config));
    call_host();
    for (;;) {
        int is_connected = wait_a_moment();

        read_all();
        if (is_connected && stream >= 0)
            send_all();
        if (robot_is_lost(&robot, now_ns()))
            call_host();
        robot_wheels(&robot, now_ns(), &left_steps_s, &right_steps_s);
        motors_set(left_steps_s, right_steps_s);
    }
}
